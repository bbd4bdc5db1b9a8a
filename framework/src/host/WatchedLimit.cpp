#include "host/WatchedLimit.h"

#include <dlfcn.h>

#include <atomic>

#include "host/PluginCall.h"

namespace viable {

namespace {

/** A limit of somebody else's library. */
class WatchedLimit : public ArmLimit {
public:
    WatchedLimit(std::string title, const LimitRow& row, const LimitScene& scene) : watch_(std::move(title)) {
        PluginCall call(&watch_, kMaking);
        std::string failure = describeThrow([&] {
            limit_ = row.make(scene);
            value_ = limit_ ? limit_->limit() : std::nullopt;
            if (limit_) allowances_ = limit_->allowances();
        });
        if (!limit_ && failure.empty()) failure = "gave none";
        if (const char* change = call.undoArithmeticChange())
            throw Error(ErrorKind::PluginFailed, watch_.title, formatArithmeticChange(change), kOnArithmeticChange);
        if (!failure.empty()) throw Error(ErrorKind::PluginFailed, watch_.title, "could not be made: it " + failure);
    }
    ~WatchedLimit() override {
        const PluginCall call(&watch_, kAfterLastTick);
        limit_.reset();
    }

    LimitSample sample(const ArmSample& arm) override {
        LimitSample found;
        PluginCall call(&watch_, kJudging);
        const char* failure = nullptr;
        try {
            found = limit_->sample(arm);
        } catch (...) {
            failure = "its check failed";
        }
        if (call.undoArithmeticChange()) failure = "its check changed the arithmetic";
        if (failure) found = {arm.worst, true, false, false, 0.0, failure, "", ""};
        for (const char** name : {&found.part, &found.other, &found.otherLink})
            if (!*name) *name = "";
        return found;
    }
    std::optional<double> limit() const override { return value_; }
    std::vector<std::pair<std::string, double>> allowances() const override { return allowances_; }
    const char* otherName(int index) const override {
        const PluginCall call(&watch_, kJudging);
        try {
            const char* const name = limit_->otherName(index);
            return name ? name : "";
        } catch (...) {
            return "";
        }
    }

private:
    mutable PluginWatch watch_;
    std::unique_ptr<ArmLimit> limit_;
    std::optional<double> value_;
    std::vector<std::pair<std::string, double>> allowances_;
};

}  // namespace

std::string findLimitLibrary(LimitKind kind) {
    Dl_info info{};
    if (dladdr(reinterpret_cast<const void*>(getLimitRow(kind).make), &info) != 0 && info.dli_fname)
        for (const std::atomic<const char*>& file : loadedLibraries())
            if (file && std::string(file) == info.dli_fname) return info.dli_fname;
    return "";
}

std::unique_ptr<ArmLimit> makeLimit(LimitKind kind, const LimitScene& scene) {
    const LimitRow& row = getLimitRow(kind);
    const std::string library = findLimitLibrary(kind);
    if (library.empty()) return row.make(scene);
    return std::make_unique<WatchedLimit>(
        std::string("the limit '") + getName(kind, LimitSide::Neither) + "' (" + library + ")", row, scene);
}

}  // namespace viable
