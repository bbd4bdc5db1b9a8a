#include "TargetSocket.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/random.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>

#include "viable/core/Error.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

Error makeError(const fs::path& place, const std::string& what, const std::string& remedy) {
    return Error(ErrorKind::PluginFailed, place.string(), what, remedy);
}

Error makeSystemError(const fs::path& place, const char* what) {
    return makeError(
        place, std::string(what) + ": " + std::strerror(errno),
        "Targets come over a socket in a folder of your own: set XDG_RUNTIME_DIR to one that can be written.");
}

std::string formatToken(const TargetSocket::Token& token) {
    constexpr char kDigits[] = "0123456789abcdef";
    std::string text;
    for (const std::uint8_t byte : token) {
        text += kDigits[byte >> 4];
        text += kDigits[byte & 15];
    }
    return text;
}

/** A folder that nobody else can look into. */
void makeFolder(const fs::path& folder) {
    if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST) throw makeSystemError(folder, "it cannot be made");
    struct stat found {};
    if (::lstat(folder.c_str(), &found) != 0) throw makeSystemError(folder, "it cannot be looked at");
    if (!S_ISDIR(found.st_mode) || found.st_uid != ::geteuid() || (found.st_mode & 077) != 0)
        throw makeError(folder, "it is no folder of this user alone, so others could send targets",
                        "Remove it, or chmod 700, or set XDG_RUNTIME_DIR.");
}

sockaddr_un makeAddress(const fs::path& file) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    if (file.string().size() >= sizeof address.sun_path)
        throw makeError(file, "this path is too long for a socket", "Set XDG_RUNTIME_DIR to a shorter one.");
    std::memcpy(address.sun_path, file.c_str(), file.string().size());
    return address;
}

}  // namespace

fs::path TargetSocket::findFolder() {
    const char* const runtime = std::getenv("XDG_RUNTIME_DIR");
    if (runtime && fs::path(runtime).is_absolute()) return fs::path(runtime) / "viable";
    return fs::path("/tmp") / ("viable-" + std::to_string(::geteuid()));
}

std::shared_ptr<TargetSocket> TargetSocket::open(const std::string& name) {
    static std::mutex mutex;
    static std::map<fs::path, std::shared_ptr<TargetSocket>> all;
    const fs::path folder = findFolder(), base = folder / name;
    const std::lock_guard<std::mutex> guard(mutex);
    std::shared_ptr<TargetSocket>& mine = all[base];
    if (!mine) {
        makeFolder(folder);
        mine.reset(new TargetSocket(base));
    } else if (mine.use_count() > 1) {
        throw makeError(base, "another case of this run listens under this name",
                        "Run the cases one after the other (--jobs 1), or give each a `name` of its own.");
    }
    return mine;
}

TargetSocket::TargetSocket(fs::path base) : base_(std::move(base)) {
    const std::string lock = base_.string() + ".lock", path = base_.string() + ".socket";
    const sockaddr_un address = makeAddress(path);
    lock_ = ::open(lock.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (lock_ < 0) throw makeSystemError(lock, "it cannot be made");
    if (::flock(lock_, LOCK_EX | LOCK_NB) != 0)
        throw makeError(path, "another program of viable listens there",
                        "End that one, or give this one another `name`.");
    for (const std::string& left : {base_.string() + ".json", path}) ::unlink(left.c_str());  // by one that has ended
    socket_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (socket_ < 0 || ::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
        ::chmod(path.c_str(), 0600) != 0)
        throw makeSystemError(path, "it cannot be opened");
    if (::getrandom(token_.data(), token_.size(), 0) != static_cast<ssize_t>(token_.size()))
        throw makeSystemError(path, "there are no random numbers for a token");
}

TargetSocket::~TargetSocket() {
    ::unlink((base_.string() + ".json").c_str());
    ::unlink((base_.string() + ".socket").c_str());
}

void TargetSocket::describe(const std::string& content) const {
    const std::string file = base_.string() + ".json", made = file + ".new";
    const std::string text = "{\"token\": \"" + formatToken(token_) + "\", " + content + "}\n";
    ::unlink(made.c_str());
    const detail::Descriptor descriptor(::open(made.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
    const bool isWritten =
        descriptor >= 0 && ::write(descriptor, text.data(), text.size()) == static_cast<ssize_t>(text.size());
    if (!isWritten || ::rename(made.c_str(), file.c_str()) != 0) throw makeSystemError(file, "it cannot be written");
}

void TargetSocket::drain() noexcept {
    std::uint8_t any = 0;
    while (receive(&any, sizeof any) >= 0) {
    }
}

std::ptrdiff_t TargetSocket::receive(void* to, std::size_t capacity) noexcept {
    senderSize_ = sizeof sender_;
    return ::recvfrom(socket_, to, capacity, MSG_DONTWAIT | MSG_TRUNC, reinterpret_cast<sockaddr*>(&sender_),
                      &senderSize_);
}

void TargetSocket::answer(const void* from, std::size_t size) noexcept {
    // It has no address, or a path: looking that up may take long, and whoever listens there need not be the sender.
    if (senderSize_ <= offsetof(sockaddr_un, sun_path) || sender_.sun_path[0] != '\0') return;
    (void)::sendto(socket_, from, size, MSG_DONTWAIT | MSG_NOSIGNAL, reinterpret_cast<const sockaddr*>(&sender_),
                   senderSize_);
}

}  // namespace viable
