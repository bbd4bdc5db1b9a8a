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

SweepFiles findSweepFiles(const Experiment& experiment) {
    SweepFiles files;
    for (const CasePlan& plan : experiment.cases) {
        for (const fs::directory_entry& entry : fs::directory_iterator(plan.robot.folder)) {
            const std::string kind = entry.path().extension().string();
            if (kind == ".urdf" || kind == ".yaml") files.data.insert(entry.path());
        }
        for (const PluginChoice* choice : listChoices(plan)) {
            files.libraries.insert(choice->plugin.library);
            for (std::uint64_t i = 0; i < choice->plugin.entry->parameterCount; ++i) {
                const ParameterSpec& spec = choice->plugin.entry->parameters[i];
                if (spec.type != ParameterType::File) continue;
                const ConfigNode* file = choice->parameters.resolved().find(spec.name);
                if (file && fs::is_regular_file(file->text)) files.data.insert(file->text);
            }
        }
    }
    return files;
}

std::string calcSweepHash(const std::string& text, const std::vector<std::string>& overrides,
                          const SweepFiles& files) {
    // By name and content: the same files may lie elsewhere on another machine.
    std::set<std::pair<std::string, std::string>> contents;
    for (const std::set<fs::path>* some : {&files.data, &files.libraries})
        for (const fs::path& file : *some) {
            const std::string name = file.filename().string();
            Hash own;
            own.add(name, readWhole(file));
            contents.emplace(name, own.take());
        }
    Hash hash;
    hash.add("viable", VIABLE_VERSION);
    hash.add("experiment", text);
    for (const std::string& assignment : overrides) hash.add("--set", assignment);
    for (const auto& [name, content] : contents) hash.add(name, content);
    return hash.take();
}

}  // namespace viable
