#include "host/WatchedLimit.h"

#include "host/PluginCall.h"
#include "limits/LimitRows.h"

namespace viable {

namespace {

constexpr char kOnRow[] = "Let its LimitRow's functions throw nothing, and make() give a limit.";

bool isOfLibrary(LimitKind kind) {
    return !detail::findLimitLibraries(kind).empty();
}

std::string makeTitle(LimitKind kind) {
    std::string title = std::string("the limit '") + getName(kind, LimitSide::Neither) + "'";
    for (const std::string& library : detail::findLimitLibraries(kind)) title += " (" + library + ")";
    return title;
}

/** Runs code of a kind's row. Throws Error (PluginFailed) where that fails.
@param failed  begins the sentence on it: "could not be made" */
template <class Work>
void callRow(LimitKind kind, PluginWatch& watch, std::int64_t tick, const char* failed, const Work& work) {
    PluginCall call(isOfLibrary(kind) ? &watch : nullptr, tick);
    const std::string failure = describeThrow(work);
    if (const char* change = call.undoArithmeticChange())
        throw Error(ErrorKind::PluginFailed, watch.title, formatArithmeticChange(change), kOnArithmeticChange);
    if (!failure.empty())
        throw Error(ErrorKind::PluginFailed, watch.title, std::string(failed) + ": it " + failure, kOnRow);
}

void checkMade(const ArmLimit* limit, const std::string& title) {
    if (!limit) throw Error(ErrorKind::PluginFailed, title, "could not be made: it gave none", kOnRow);
}

/** A limit of somebody else's library. */
class WatchedLimit : public ArmLimit {
public:
    explicit WatchedLimit(LimitKind kind) : watch_(makeTitle(kind)) {}
    /** Where it throws, the destructor runs: its limit is destroyed under the watch. */
    WatchedLimit(LimitKind kind, const LimitScene& scene) : WatchedLimit(kind) {
        callRow(kind, watch_, kMaking, "could not be made", [&] {
            limit_ = getLimitRow(kind).make(scene);
            if (!limit_) return;
            value_ = limit_->limit();
            allowances_ = limit_->allowances();
        });
        checkMade(limit_.get(), watch_.title);
    }
    ~WatchedLimit() override {
        PluginCall call(&watch_, kAfterLastTick);
        limit_.reset();
        call.undoArithmeticChange();
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

bool hasLimit(LimitKind kind, const LimitScene& scene) {
    const LimitRow& row = getLimitRow(kind);
    if (!row.make || !row.exists) return row.make != nullptr;
    bool has = false;
    PluginWatch watch(makeTitle(kind));
    callRow(kind, watch, kAsking, "could not say whether a case has it", [&] { has = row.exists(scene); });
    return has;
}

std::unique_ptr<ArmLimit> makeLimit(LimitKind kind, const LimitScene& scene) {
    if (isOfLibrary(kind)) return std::make_unique<WatchedLimit>(kind, scene);
    std::unique_ptr<ArmLimit> limit = getLimitRow(kind).make(scene);
    checkMade(limit.get(), makeTitle(kind));
    return limit;
}

std::string tellOf(LimitKind kind, const std::function<std::string()>& words) try {
    std::string text;
    PluginWatch watch(makeTitle(kind));
    callRow(kind, watch, kJudging, "could not tell", [&] { text = words(); });
    return text;
} catch (const Error&) {
    return "(its words failed)";
}

}  // namespace viable
