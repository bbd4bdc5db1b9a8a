#include <openssl/evp.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <memory>
#include <set>
#include <sstream>

#include "viable/core/Error.h"
#include "viable/sweep/SweepStore.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

/** SHA-256 over named pieces; the lengths keep their borders. */
class Hash {
public:
    Hash() : context_(EVP_MD_CTX_new(), &EVP_MD_CTX_free) {
        VIABLE_CHECK(context_ && EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr) == 1,
                     "libcrypto has SHA-256");
    }
    void add(const std::string& name, const std::string& content) {
        for (const std::string* text : {&name, &content}) {
            const std::string length = std::to_string(text->size()) + ":";
            EVP_DigestUpdate(context_.get(), length.data(), length.size());
            EVP_DigestUpdate(context_.get(), text->data(), text->size());
        }
    }
    std::string take() {
        std::array<unsigned char, EVP_MAX_MD_SIZE> bytes;
        unsigned size = 0;
        EVP_DigestFinal_ex(context_.get(), bytes.data(), &size);
        std::string digits;
        for (unsigned i = 0; i < size; ++i)
            for (const int half : {bytes[i] >> 4, bytes[i] & 15})
                digits += "0123456789abcdef"[half];
        return digits;
    }

private:
    std::unique_ptr<EVP_MD_CTX, void (*)(EVP_MD_CTX*)> context_;
};

std::string readWhole(const fs::path& file) {
    std::ifstream stream(file, std::ios::binary);
    std::ostringstream text;
    text << stream.rdbuf();
    if (!stream) throw badInput(file.string(), "cannot be read", "Check its permissions.");
    return text.str();
}

std::vector<const PluginChoice*> listChoices(const CasePlan& plan) {
    std::vector<const PluginChoice*> choices = {&plan.command, &plan.controller};
    for (const PluginChoice& filter : plan.filters) choices.push_back(&filter);
    if (plan.robustLoop) choices.push_back(&*plan.robustLoop);
    if (plan.realPlant) choices.push_back(&*plan.realPlant);
    return choices;
}

}  // namespace

std::string calcSweepHash(const std::string& text, const std::vector<std::string>& overrides,
                          const Experiment& experiment) {
    Hash hash;
    hash.add("viable", VIABLE_VERSION);
    hash.add("experiment", text);
    for (const std::string& assignment : overrides) hash.add("--set", assignment);
    std::set<fs::path> robots, files;
    for (const CasePlan& plan : experiment.cases) {
        robots.insert(plan.robot.folder);
        for (const PluginChoice* choice : listChoices(plan))
            for (std::uint64_t i = 0; i < choice->plugin.entry->parameterCount; ++i) {
                const ParameterSpec& spec = choice->plugin.entry->parameters[i];
                if (spec.type != ParameterType::File) continue;
                const ConfigNode* file = choice->parameters.resolved().find(spec.name);
                if (file && fs::is_regular_file(file->text)) files.insert(file->text);
            }
    }
    // Robots by name, so that a folder may stand elsewhere on another machine.
    for (const fs::path& robot : robots) {
        std::set<fs::path> own;
        for (const fs::directory_entry& entry : fs::directory_iterator(robot)) {
            const std::string kind = entry.path().extension().string();
            if (kind == ".urdf" || kind == ".yaml") own.insert(entry.path());
        }
        for (const fs::path& file : own) hash.add(file.filename().string(), readWhole(file));
    }
    for (const fs::path& file : files) hash.add(file.filename().string(), readWhole(file));
    return hash.take();
}

}  // namespace viable
