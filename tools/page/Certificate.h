#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace viable {

/** A page's certificate and its private key, PEM. */
struct Certificate {
    std::string certificate, key;
    std::string fingerprint;  ///< SHA-256 of the certificate as browsers show it, "AB:CD:..."
};

/** Where a user's page keeps its key: $XDG_STATE_HOME/viable, or ~/.local/state/viable. Throws Error where there is no home. */
std::filesystem::path findKeyFolder();

/** The certificate of this machine and user (P-256, signed by itself, ten years), made at the first call: page_certificate.pem
and page_key.pem, readable by the user alone. Made anew, of the same key, where it has expired or does not state one of the names; it
then states those that it stated before, too. Throws Error: where the key may be read by others, the files or their folder are
not the user's own, are damaged or cannot be written. Calls at once, also of several programs, get the same one.
@param names  host names and addresses that it states */
Certificate readOrMakeCertificate(const std::filesystem::path& folder, const std::vector<std::string>& names);

}  // namespace viable
