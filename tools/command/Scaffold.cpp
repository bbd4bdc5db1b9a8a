#include "Scaffold.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <sstream>

#include "Commands.h"
#include "core/Text.h"
#include "core/WholeFile.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLongestName = 60;

constexpr const char* kKeywords =
    " alignas alignof and and_eq asm auto bitand bitor bool break case catch char char16_t char32_t char8_t class "
    "co_await co_return co_yield compl concept const const_cast consteval constexpr constinit continue decltype "
    "default delete do double dynamic_cast else enum explicit export extern false float for friend goto if inline "
    "int long mutable namespace new noexcept not not_eq nullptr operator or or_eq private protected public register "
    "reinterpret_cast requires return short signed sizeof static static_assert static_cast struct switch template "
    "this thread_local throw true try typedef typeid typename union unsigned using virtual void volatile wchar_t "
    "while xor xor_eq ";

/** Names whose class, CMake project or test would meet one that is there already. */
constexpr const char* kTaken =
    " certified eigen false no null off on plugin_bench set_up setup simbody_plant std tear_down test testing true "
    "viable "
    "yes ";

bool isAmong(const std::string& name, const char* words) {
    return std::strstr(words, (" " + name + " ").c_str()) != nullptr;
}

bool isLower(char c) {
    return c >= 'a' && c <= 'z';
}
bool isUpper(char c) {
    return c >= 'A' && c <= 'Z';
}
bool isDigit(char c) {
    return c >= '0' && c <= '9';
}

bool isSnakeCase(const std::string& name) {
    if (name.empty() || !isLower(name.front()) || name.back() == '_') return false;
    for (std::size_t i = 0; i < name.size(); ++i)
        if (!(isLower(name[i]) || isDigit(name[i]) || (name[i] == '_' && name[i - 1] != '_'))) return false;
    return true;
}

/** "MyPDFilter", "my-filter", "2nd law" -> "my_pd_filter", "my_filter", "filter_2nd_law". */
std::string toSnakeCase(const std::string& text, const std::string& kind) {
    std::string name;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const char c = text[i];
        if (isUpper(c)) {
            const bool startsWord = i > 0 && (isLower(text[i - 1]) || isDigit(text[i - 1]) ||
                                              (isUpper(text[i - 1]) && i + 1 < text.size() && isLower(text[i + 1])));
            if (startsWord && !name.empty() && name.back() != '_') name += '_';
            name += static_cast<char>(c - 'A' + 'a');
        } else if (isLower(c) || isDigit(c)) {
            name += c;
        } else if (!name.empty() && name.back() != '_') {
            name += '_';
        }
    }
    while (!name.empty() && name.back() == '_') name.pop_back();
    if (!name.empty() && isDigit(name.front())) name = kind + "_" + name;
    return name;
}

/** A name near to `text` that checkNewName() takes. */
std::string suggestName(const std::string& text, const std::string& kind, bool isClass) {
    const std::string name = toSnakeCase(text, kind);
    if (name.empty() || name.size() > kLongestName) return "my_" + kind;
    return isClass && (isAmong(name, kKeywords) || isAmong(name, kTaken)) ? name + "_" + kind : name;
}

/** The name for a message: cut when long, without bytes that would garble a terminal. */
std::string quote(const std::string& name) {
    std::string shown = name.size() > kLongestName ? name.substr(0, kLongestName) + "..." : name;
    for (char& c : shown)
        if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
    return "`" + shown + "`";
}

Error failure(const fs::path& path, int error) {
    const bool isWrongPlace = error == ENOTDIR || error == EEXIST || error == ENOTEMPTY || error == ENAMETOOLONG;
    return Error(isWrongPlace ? ErrorKind::BadInput : ErrorKind::LogNotWritten, path.string(),
                 std::string("this cannot be written: ") + std::strerror(error),
                 error == EACCES || error == EROFS ? "Choose a folder of your own: --out FOLDER."
                                                   : "Nothing was left behind; put it right and try again.");
}

/** A folder beside the one to be made; removed, with those made above it, unless it was kept. */
class PendingFolder {
public:
    explicit PendingFolder(const fs::path& target) : target_(target) {
        const fs::path parent = target.parent_path();
        for (fs::path p = parent; !p.empty() && !fs::exists(p); p = p.parent_path()) made_.push_back(p);
        std::error_code failed;
        fs::create_directories(parent, failed);
        if (failed) abandon(parent, failed.value());
        std::string pattern = (parent / ("." + target.filename().string() + ".XXXXXX")).string();
        if (!mkdtemp(pattern.data())) abandon(parent, errno);
        path_ = pattern;
    }
    ~PendingFolder() { remove(); }
    PendingFolder(const PendingFolder&) = delete;
    PendingFolder& operator=(const PendingFolder&) = delete;

    void write(const std::string& name, const std::string& text) {
        const fs::path file = path_ / name;
        errno = 0;
        std::ofstream stream(file, std::ios::binary);
        stream << text;
        stream.close();
        if (!stream) throw failure(target_ / name, errno == 0 ? EIO : errno);
    }
    void keep() {
        const mode_t mask = umask(0);
        umask(mask);
        // mkdtemp's folder is the owner's alone. An empty folder in the place is replaced, nothing else is.
        if (chmod(path_.c_str(), 0777 & ~mask) != 0 || std::rename(path_.c_str(), target_.c_str()) != 0)
            throw failure(target_, errno);
        path_.clear();
        made_.clear();
    }

private:
    [[noreturn]] void abandon(const fs::path& path, int error) {
        remove();
        throw failure(path, error);
    }
    void remove() {
        std::error_code ignored;
        if (!path_.empty()) fs::remove_all(path_, ignored);
        for (const fs::path& folder : made_) fs::remove(folder, ignored);  // only while empty
    }

    fs::path target_, path_;
    std::vector<fs::path> made_;  // innermost first
};

}  // namespace

fs::path getProgram() {
    std::error_code failed;
    return fs::read_symlink("/proc/self/exe", failed);
}

fs::path findShared(const char* name) {
    return getProgram().parent_path() / ".." / "share" / "viable" / name;
}

fs::path getTemplates() {
    return findShared("templates").lexically_normal();
}

std::string getProgramWord() {
    const fs::path program = getProgram();
    if (const char* variable = std::getenv("PATH")) {
        std::istringstream folders(variable);
        std::error_code failed;
        for (std::string folder; std::getline(folders, folder, ':');)
            if (fs::exists(fs::path(folder) / "viable", failed))
                return fs::equivalent(fs::path(folder) / "viable", program, failed)
                           ? "viable"
                           : detail::quoteForShell(program.string());
    }
    return detail::quoteForShell(program.string());
}

std::string showPath(const fs::path& path) {
    return detail::quoteForShell(path.string());
}

void checkNewName(const std::string& name, const std::string& kind, bool isClass) {
    const std::string where = "new " + kind;
    if (name.find('/') != std::string::npos) {
        const fs::path path = fs::path(name + "/").lexically_normal().parent_path();
        const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
        throw badInput(where, "the name " + quote(name) + " is a path",
                       "Give the folder around it apart: `" + suggestName(path.filename().string(), kind, isClass) +
                           " --out " + folder.string() + "`.");
    }
    if (!isSnakeCase(name))
        throw badInput(where, "the name " + quote(name) + " is not snake_case",
                       "Write small letters of English, digits and single underscores, beginning with a letter: `" +
                           suggestName(name, kind, isClass) + "`.");
    if (name.size() > kLongestName)
        throw badInput(where,
                       "the name " + quote(name) + " has " + std::to_string(name.size()) + " letters; at most " +
                           std::to_string(kLongestName) + " are allowed",
                       "Choose a shorter one.");
    const bool isKeyword = isAmong(name, kKeywords);
    if (isClass && (isKeyword || isAmong(name, kTaken)))
        throw badInput(where,
                       "the name " + quote(name) +
                           (isKeyword ? " is a keyword of C++"
                                      : " would clash with one of viable or GoogleTest in the new project"),
                       "Add a word to it: `" + name + "_" + kind + "`.");
}

std::string makeClassName(const std::string& name) {
    std::string result;
    for (std::size_t i = 0; i < name.size(); ++i) {
        const bool startsWord = i == 0 || name[i - 1] == '_';
        if (name[i] != '_') result += startsWord && isLower(name[i]) ? static_cast<char>(name[i] - 'a' + 'A') : name[i];
    }
    return result;
}

FolderFiles fillTemplate(const fs::path& folder, const std::map<std::string, std::string>& replacements) {
    FolderFiles files;
    std::error_code failed;
    for (fs::directory_iterator entry(folder, failed), end; !failed && entry != end; entry.increment(failed)) {
        std::string name = entry->path().filename().string();
        const auto className = replacements.find("CLASS");
        if (className != replacements.end() && name.rfind("Plugin", 0) == 0) name.replace(0, 6, className->second);
        std::optional<std::string> text = readWhole(entry->path());
        if (!text) throw badInput(entry->path().string(), "this template cannot be read", "Install viable again.");
        for (const auto& [key, value] : replacements)
            text = detail::replaceAll(std::move(*text), "@" + key + "@", value);
        files[name] = *text;
    }
    if (failed || files.empty())
        throw badInput(folder.string(), "the templates of `viable new` are not there",
                       "They are installed with the program, in share/viable/templates: install viable again.");
    return files;
}

void checkNewFolder(const fs::path& target) {
    std::error_code failed;
    const fs::file_status status = fs::symlink_status(target, failed);
    if (status.type() == fs::file_type::not_found) return;
    if (status.type() != fs::file_type::directory)
        throw badInput(target.string(), "there is already a file of that name",
                       "Choose another name, or another folder with --out.");
    const bool isEmpty = fs::is_empty(target, failed);
    if (failed || !isEmpty)
        throw badInput(target.string(), failed ? "this folder cannot be read" : "this folder is not empty",
                       "Nothing is overwritten: choose another name, or another folder with --out, or remove it.");
}

void writeNewFolder(const fs::path& target, const FolderFiles& files) {
    checkNewFolder(target);
    PendingFolder pending(fs::absolute(target).lexically_normal());
    for (const auto& [name, text] : files) pending.write(name, text);
    pending.keep();
}

}  // namespace viable
