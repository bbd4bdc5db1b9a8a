#include "page/Certificate.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <openssl/bio.h>
#include <openssl/ec.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/rand.h>
#include <openssl/x509v3.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <memory>

#include "core/Text.h"
#include "core/WholeFile.h"
#include "viable/core/Error.h"

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

Error fail(const fs::path& file, const std::string& what, const std::string& remedy) {
    return badInput(file.string(), what, remedy);
}

std::string takeText(BIO* bio) {
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

/** False: OpenSSL refuses. */
bool make(const std::vector<std::string>& names, Certificate& made) {
    const Key key(EVP_EC_gen("P-256"));
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
        if (one.find_first_of(",;\n") == std::string::npos)
            detail::addItem(alternatives, (isAddress(one) ? "IP:" : "DNS:") + one, ",");
    if (!addExtension(x, NID_subject_alt_name, alternatives) ||
        !addExtension(x, NID_basic_constraints, "critical,CA:FALSE") ||
        !addExtension(x, NID_ext_key_usage, "serverAuth") || X509_sign(x, key.get(), EVP_sha256()) == 0)
        return false;
    const Bio keyText(BIO_new(BIO_s_mem())), text(BIO_new(BIO_s_mem()));
    if (!keyText || !text ||
        PEM_write_bio_PrivateKey(keyText.get(), key.get(), nullptr, nullptr, 0, nullptr, nullptr) != 1 ||
        PEM_write_bio_X509(text.get(), x) != 1)
        return false;
    made.key = takeText(keyText.get());
    made.certificate = takeText(text.get());
    return true;
}

/** "AB:CD:..."; empty: this is no certificate, or not that of the key. */
std::string calcFingerprint(const Certificate& pair) {
    const Bio text(BIO_new_mem_buf(pair.certificate.data(), static_cast<int>(pair.certificate.size())));
    const Bio keyText(BIO_new_mem_buf(pair.key.data(), static_cast<int>(pair.key.size())));
    const X509Owner certificate(PEM_read_bio_X509(text.get(), nullptr, nullptr, nullptr));
    const Key key(PEM_read_bio_PrivateKey(keyText.get(), nullptr, nullptr, nullptr));
    unsigned char digest[EVP_MAX_MD_SIZE];
    unsigned size = 0;
    if (!certificate || !key || X509_check_private_key(certificate.get(), key.get()) != 1 ||
        X509_digest(certificate.get(), EVP_sha256(), digest, &size) != 1)
        return {};
    std::string print;
    for (unsigned i = 0; i < size; ++i) detail::addItem(print, detail::format("%02X", digest[i]), ":");
    return print;
}

/** Creates a file that only its user may read. */
void writePrivate(const fs::path& file, const std::string& text) {
    const int descriptor = ::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0600);
    const int code = descriptor < 0 ? errno : detail::writeAll(descriptor, text);
    if (descriptor >= 0) ::close(descriptor);
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
    if (!fs::exists(keyFile, error)) {
        fs::create_directories(folder.parent_path(), error);
        if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST)
            throw fail(folder, std::string("the folder of the page's key cannot be made: ") + std::strerror(errno),
                       "Make the folder above it writable, or name another one in XDG_STATE_HOME.");
        Certificate made;
        if (!make(names, made))
            throw fail(folder, "OpenSSL cannot make a certificate", "Its configuration may forbid the curve P-256.");
        writePrivate(file, made.certificate);
        writePrivate(keyFile, made.key);
    }
    struct ::stat status {};
    if (::stat(keyFile.c_str(), &status) != 0 || (status.st_mode & 077) != 0)
        throw fail(keyFile, "other users may read the page's private key",
                   "They may have copied it: delete it, and the next start makes a new one.");
    Certificate pair{readWhole(file).value_or(""), readWhole(keyFile).value_or(""), {}};
    pair.fingerprint = calcFingerprint(pair);
    if (pair.fingerprint.empty())
        throw fail(keyFile, "this and page_certificate.pem are not a key and its certificate",
                   "Delete both: the next start makes new ones.");
    return pair;
}

}  // namespace viable
