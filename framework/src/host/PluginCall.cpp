#include "host/PluginCall.h"

#include <cstring>
#include <mutex>

#include "core/Text.h"
#include "host/FloatingPointGuard.h"
#include "host/ProcessGuard.h"

namespace viable {

namespace {

std::array<CallSlot, 256> slots;
std::array<std::atomic<const char*>, 64> libraries{};
std::mutex librariesMutex;
std::atomic<AllocationCount> allocationCounter{nullptr};

/** A thread's hold on its slot. */
struct SlotOwner {
    CallSlot* slot = nullptr;
    bool asked = false;
    ~SlotOwner() {
        if (slot) slot->taken.store(false, std::memory_order_release);
    }
};
thread_local SlotOwner owner;
// Beside the owner, without a destructor: a signal handler may read it at any time.
thread_local CallSlot* ownSlot = nullptr;

CallSlot* claimSlot() {
    if (owner.asked) return ownSlot;
    owner.asked = true;
    for (CallSlot& slot : slots) {
        if (slot.taken.exchange(true, std::memory_order_acq_rel)) continue;
        owner.slot = ownSlot = &slot;
        break;
    }
    return ownSlot;
}

}  // namespace

PluginWatch::PluginWatch(const PluginInfo& plugin)
    : title(std::string("the ") + getName(plugin.kind) + " plugin '" + plugin.name + "' (" + plugin.library.string() +
            ")") {
    addSharedChange(*this, "loaded", findLoadChange(plugin.library));
}

const std::array<CallSlot, 256>& callSlots() {
    return slots;
}

const CallSlot* ownCallSlot() {
    return ownSlot;
}

void useCallSlot(CallSlot& slot) {
    owner.asked = true;
    ownSlot = &slot;
}

const std::array<std::atomic<const char*>, 64>& loadedLibraries() {
    return libraries;
}

void addLoadedLibrary(const std::string& file) {
    const std::lock_guard<std::mutex> lock(librariesMutex);
    for (std::atomic<const char*>& library : libraries) {
        const char* const known = library.load();
        if (known && file == known) return;
        if (known) continue;
        library = strdup(file.c_str());  // for as long as the process lives, as the library
        return;
    }
}

const char* nameCall(std::int64_t tick) {
    static constexpr std::pair<std::int64_t, const char*> kCalls[] = {{kAfterLastTick, "while it was destroyed"},
                                                                      {kLoading, "while it was loaded"},
                                                                      {kMaking, "while it was made"},
                                                                      {kConfiguring, "in configure()"},
                                                                      {kAsking, "while it was asked what it is"},
                                                                      {kResetting, "in reset()"},
                                                                      {kJudging, "while it judged an arm"}};
    for (const auto& [call, words] : kCalls)
        if (call == tick) return words;
    return tick < 0 ? "before the first tick" : "in a tick";
}

void setAllocationCounter(AllocationCount count) {
    allocationCounter = count;
}

std::int64_t countAllocations() {
    const AllocationCount count = allocationCounter.load(std::memory_order_relaxed);
    return count ? count() : 0;
}

PluginCall::PluginCall(PluginWatch* watch, std::int64_t tick) noexcept
    : watch_(watch), tick_(tick), control_(FloatingPointGuard::readModes()) {
    if (!watch_) return;
    if (CallSlot* slot = claimSlot()) {
        outerWatch_ = slot->watch.load(std::memory_order_relaxed);
        outerTick_ = slot->tick.load(std::memory_order_relaxed);
        slot->tick.store(tick, std::memory_order_relaxed);
        slot->watch.store(watch_, std::memory_order_release);
        slot->calls.fetch_add(1, std::memory_order_relaxed);
    }
    allocations_ = countAllocations();
}

PluginCall::~PluginCall() {
    if (!watch_) return;
    if (CallSlot* slot = ownSlot) {
        slot->tick.store(outerTick_, std::memory_order_relaxed);
        slot->watch.store(outerWatch_, std::memory_order_release);
        slot->calls.fetch_add(1, std::memory_order_relaxed);
    }
    if (tick_ < kWarmUpTicks || countAllocations() == allocations_) return;
    if (watch_->lastAllocation == tick_) return;  // in an earlier call of the same tick
    if (watch_->firstAllocation < 0) watch_->firstAllocation = tick_;
    watch_->lastAllocation = tick_;
    ++watch_->allocatingTicks;
}

std::string formatArithmeticChange(const char* change) {
    return detail::format(kArithmeticChange, change);
}

void addSharedChange(PluginWatch& watch, const char* when, const std::string& change) {
    if (!change.empty()) detail::addItem(watch.sharedChange, std::string("when it was ") + when + ": " + change, "; ");
}

std::string formatSharedChange(const PluginWatch& watch) {
    return watch.title + " changed what all of the program shares (" + watch.sharedChange +
           "). It was set back: a plugin and the libraries that it loads leave locale, working folder and signals "
           "alone.";
}

const char* PluginCall::undoArithmeticChange() noexcept {
    const char* change = FloatingPointGuard::findChange(control_);
    if (change) FloatingPointGuard::setModes(control_);
    return change;
}

void resetPlugin(Plugin& plugin, PluginKind kind, PluginWatch* watch, const MotionState& start) {
    const std::string who = watch ? watch->title : std::string("the ") + getName(kind) + " plugin";
    PluginCall call(watch, kResetting);
    try {
        plugin.reset(start);
    } catch (const PluginFault& e) {
        throw Error(ErrorKind::PluginFailed, who, e.what(), e.remedy());
    } catch (const Error& e) {
        if (!watch) throw;
        if (kind == PluginKind::RealPlant ||
            kind == PluginKind::CommandSource)  // the robot, or the device, cannot be had
            throw Error(e.kind(), who, e.what());
        throw Error(ErrorKind::PluginFailed, who, std::string("threw in reset(): ") + e.what(), kOnThrow);
    } catch (const std::exception& e) {
        throw Error(ErrorKind::PluginFailed, who, std::string("threw in reset(): ") + e.what(), kOnThrow);
    } catch (...) {
        throw Error(ErrorKind::PluginFailed, who, "threw something other than a std::exception in reset()", kOnThrow);
    }
    if (const char* change = call.undoArithmeticChange())
        throw Error(ErrorKind::PluginFailed, who, formatArithmeticChange(change), kOnArithmeticChange);
}

}  // namespace viable
