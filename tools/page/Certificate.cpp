#include "page/Certificate.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <openssl/bio.h>
#include <openssl/ec.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/rand.h>
#include <openssl/x509v3.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <memory>

#include "core/Descriptor.h"
#include "core/Text.h"
#include "core/WholeFile.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

template <class T, void (*kFree)(T*)>
struct Freer {
    void operator()(T* object) const { kFree(object); }
};
template <class T, void (*kFree)(T*)>
using Owned = std::unique_ptr<T, Freer<T, kFree>>;
using Key = Owned<EVP_PKEY, EVP_PKEY_free>;
using X509Owner = Owned<X509, X509_free>;
using Bio = Owned<BIO, BIO_free_all>;

constexpr long kLifetime_s = 3650L * 24 * 3600;
constexpr std::size_t kMaxNames = 64;

Error fail(const fs::path& file, const std::string& what, const std::string& remedy) {
    return badInput(file.string(), what, remedy);
}

std::string readText(BIO* bio) {
    char* bytes = nullptr;
    const long size = BIO_get_mem_data(bio, &bytes);
    return {bytes, static_cast<std::size_t>(size)};
}

bool isAddress(const std::string& name) {
    unsigned char bytes[16];
    return ::inet_pton(AF_INET, name.c_str(), bytes) == 1 || ::inet_pton(AF_INET6, name.c_str(), bytes) == 1;
}

bool addExtension(X509* certificate, int id, const std::string& value) {
    const Owned<X509_EXTENSION, X509_EXTENSION_free> extension(
        X509V3_EXT_conf_nid(nullptr, nullptr, id, value.c_str()));
    return extension && X509_add_ext(certificate, extension.get(), -1) == 1;
}

Key readKey(const std::string& text) {
    const Bio bio(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
    return Key(PEM_read_bio_PrivateKey(bio.get(), nullptr, nullptr, nullptr));
}

X509Owner readX509(const std::string& text) {
    const Bio bio(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
    return X509Owner(PEM_read_bio_X509(bio.get(), nullptr, nullptr, nullptr));
}

bool isWritable(const std::string& name) {
    return name.find_first_of(",;\n") == std::string::npos;
}

/** Adds the names that it states. */
void addNames(const X509* certificate, std::vector<std::string>& names) {
    const Owned<GENERAL_NAMES, GENERAL_NAMES_free> all(
        static_cast<GENERAL_NAMES*>(X509_get_ext_d2i(certificate, NID_subject_alt_name, nullptr, nullptr)));
    for (int i = 0; all && i < sk_GENERAL_NAME_num(all.get()) && names.size() < kMaxNames; ++i) {
        int kind = 0;
        const auto* const value =
            static_cast<const ASN1_STRING*>(GENERAL_NAME_get0_value(sk_GENERAL_NAME_value(all.get(), i), &kind));
        const unsigned char* const bytes = ASN1_STRING_get0_data(value);
        const int size = ASN1_STRING_length(value);
        char text[INET6_ADDRSTRLEN] = "";
        std::string name;
        if (kind == GEN_DNS) name.assign(reinterpret_cast<const char*>(bytes), static_cast<std::size_t>(size));
        if (kind == GEN_IPADD && (size == 4 || size == 16) &&
            ::inet_ntop(size == 4 ? AF_INET : AF_INET6, bytes, text, sizeof text))
            name = text;
        if (!name.empty() && std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
    }
}

/** It counts today, and states all the names. */
bool isGood(X509* certificate, const std::vector<std::string>& names) {
    if (X509_cmp_current_time(X509_get0_notBefore(certificate)) >= 0 ||
        X509_cmp_current_time(X509_get0_notAfter(certificate)) <= 0)
        return false;
    return std::all_of(names.begin(), names.end(), [&](const std::string& name) {
        if (!isWritable(name)) return true;
        return isAddress(name) ? X509_check_ip_asc(certificate, name.c_str(), 0) == 1
                               : X509_check_host(certificate, name.data(), name.size(), 0, nullptr) == 1;
    });
}

/** False: OpenSSL refuses. @param oldKey  PEM; empty: a new key */
bool make(const std::vector<std::string>& names, const std::string& oldKey, Certificate& made) {
    const Key key = oldKey.empty() ? Key(EVP_EC_gen("P-256")) : readKey(oldKey);
    const X509Owner certificate(X509_new());
    std::uint64_t serial = 0;
    if (!key || !certificate || RAND_bytes(reinterpret_cast<unsigned char*>(&serial), sizeof serial) != 1) return false;
    X509* const x = certificate.get();
    X509_set_version(x, 2);
    ASN1_INTEGER_set_uint64(X509_get_serialNumber(x), serial >> 1 | 1);
    X509_gmtime_adj(X509_getm_notBefore(x), -24 * 3600L);
    X509_gmtime_adj(X509_getm_notAfter(x), kLifetime_s);
    X509_set_pubkey(x, key.get());
    X509_NAME* const name = X509_get_subject_name(x);
    X509_NAME_add_entry_by_txt(name, "CN", MBSTRING_UTF8, reinterpret_cast<const unsigned char*>("viable live"), -1, -1,
                               0);
    X509_set_issuer_name(x, name);
    std::string alternatives;
    for (const std::string& one : names)
        if (isWritable(one)) detail::addItem(alternatives, (isAddress(one) ? "IP:" : "DNS:") + one, ",");
    if (!addExtension(x, NID_subject_alt_name, alternatives) ||
        !addExtension(x, NID_basic_constraints, "critical,CA:FALSE") ||
        !addExtension(x, NID_ext_key_usage, "serverAuth") || X509_sign(x, key.get(), EVP_sha256()) == 0)
        return false;
    const Bio keyText(BIO_new(BIO_s_mem())), text(BIO_new(BIO_s_mem()));
    if (!keyText || !text ||
        PEM_write_bio_PrivateKey(keyText.get(), key.get(), nullptr, nullptr, 0, nullptr, nullptr) != 1 ||
        PEM_write_bio_X509(text.get(), x) != 1)
        return false;
    made.key = readText(keyText.get());
    made.certificate = readText(text.get());
    return true;
}

/** "AB:CD:..."; empty: this is no certificate, or not that of the key. */
std::string calcFingerprint(const Certificate& pair) {
    const X509Owner certificate = readX509(pair.certificate);
    const Key key = readKey(pair.key);
    unsigned char digest[EVP_MAX_MD_SIZE];
    unsigned size = 0;
    if (!certificate || !key || X509_check_private_key(certificate.get(), key.get()) != 1 ||
        X509_digest(certificate.get(), EVP_sha256(), digest, &size) != 1)
        return {};
    std::string print;
    for (unsigned i = 0; i < size; ++i) detail::addItem(print, detail::format("%02X", digest[i]), ":");
    return print;
}

/** The text of a file that only its user may read, and nobody else has written; none: there is no file. */
std::optional<std::string> readPrivate(const fs::path& file) {
    const detail::Descriptor opened(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
    if (opened < 0 && errno == ENOENT) return std::nullopt;
    if (opened < 0)
        throw fail(file, std::string("it cannot be read: ") + std::strerror(errno),
                   "Delete it, and the next start makes a new one.");
    struct ::stat status {};
    if (::fstat(opened, &status) != 0 || !S_ISREG(status.st_mode) || status.st_uid != ::geteuid() ||
        status.st_nlink != 1)
        throw fail(file, "it is no file of the user's own with this one name",
                   "Others may have put it there: delete it, and the next start makes a new one.");
    if ((status.st_mode & 077) != 0)
        throw fail(file, "other users may read the page's private key",
                   "They may have copied it: delete it, and the next start makes a new one.");
    std::string text;
    char bytes[4096];
    ssize_t count = 0;
    while ((count = ::read(opened, bytes, sizeof bytes)) > 0 && text.size() < 1000000)
        text.append(bytes, static_cast<std::size_t>(count));
    return text;
}

/** Gives a file that only its user may read a new text, whole or not at all. The folder is locked. */
void writePrivate(const fs::path& file, const std::string& text) {
    const fs::path part = file.string() + ".part";
    ::unlink(part.c_str());  // of a start that was killed
    int code = 0;
    {
        const detail::Descriptor opened(
            ::open(part.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600));
        code = opened < 0 ? errno : detail::writeAll(opened, text);
        if (code == 0 && ::fsync(opened) != 0) code = errno;
    }
    if (code == 0 && ::rename(part.c_str(), file.c_str()) != 0) code = errno;
    if (code != 0)
        throw fail(file, std::string("the page's key cannot be written: ") + std::strerror(code),
                   "Make its folder writable, or name another one in XDG_STATE_HOME.");
}

}  // namespace

fs::path findKeyFolder() {
    if (const char* state = std::getenv("XDG_STATE_HOME"); state && fs::path(state).is_absolute())
        return fs::path(state) / "viable";
    if (const char* home = std::getenv("HOME"); home && fs::path(home).is_absolute())
        return fs::path(home) / ".local" / "state" / "viable";
    throw badInput("--page", "there is no place for the page's key: HOME is not set", "Set HOME or XDG_STATE_HOME.");
}

Certificate readOrMakeCertificate(const fs::path& folder, const std::vector<std::string>& names) {
    const fs::path keyFile = folder / "page_key.pem", file = folder / "page_certificate.pem";
    std::error_code error;
    fs::create_directories(folder.parent_path(), error);
    if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST)
        throw fail(folder, std::string("the folder of the page's key cannot be made: ") + std::strerror(errno),
                   "Make the folder above it writable, or name another one in XDG_STATE_HOME.");
    struct ::stat status {};
    if (::stat(folder.c_str(), &status) != 0 || status.st_uid != ::geteuid() || (status.st_mode & 022) != 0)
        throw fail(folder, "other users may change this folder, in which the page's private key is",
                   "Make it yours alone (chmod 700), or name another one in XDG_STATE_HOME.");
    const fs::path lockFile = folder / "page_lock";
    const detail::Descriptor lock(
        ::open(lockFile.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));  // one start at a time
    if (lock < 0 || ::flock(lock, LOCK_EX) != 0)
        throw fail(lockFile, std::string("it cannot be locked: ") + std::strerror(errno),
                   "Make its folder writable, or name another one in XDG_STATE_HOME.");

    const std::optional<std::string> key = readPrivate(keyFile);
    Certificate pair{key ? readPrivate(file).value_or("") : "", key.value_or(""), {}};
    pair.fingerprint = calcFingerprint(pair);
    if (key && pair.fingerprint.empty())
        throw fail(keyFile, "this and page_certificate.pem are not a key and its certificate",
                   "Delete both: the next start makes new ones.");
    const X509Owner stored = key ? readX509(pair.certificate) : nullptr;
    if (stored && isGood(stored.get(), names)) return pair;
    std::vector<std::string> all = names;
    if (stored) addNames(stored.get(), all);  // a browser of another network knows it by those
    Certificate made;
    if (!make(all, pair.key, made))
        throw fail(folder, "OpenSSL cannot make a certificate", "Its configuration may forbid the curve P-256.");
    made.fingerprint = calcFingerprint(made);
    writePrivate(file, made.certificate);
    if (!key) writePrivate(keyFile, made.key);
    return made;
}

}  // namespace viable
