#include <qrencode.h>
#include <unistd.h>

#include <CLI/CLI.hpp>

#include "Commands.h"
#include "CrashHandler.h"
#include "ExperimentArguments.h"
#include "LiveKeys.h"
#include "RunFolder.h"
#include "StopSignals.h"
#include "core/Text.h"
#include "core/WholeFile.h"
#include "host/PythonClass.h"
#include "live/LiveStart.h"
#include "page/LiveFrame.h"
#include "page/PageServer.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

constexpr int kLook_ms = 20, kPageLook_ms = 4;
constexpr unsigned short kPagePort = 8484;
constexpr double kTerminalLine_s = 0.1, kPlainLine_s = 5.0;

struct LiveArguments {
    std::string file, caseName, out;
    std::vector<std::string> overrides;
    RealTimeWish realTime;
    std::optional<double> duration_s;
    double logLimit_MB = 4096.0;
    std::string page;
    bool hasPage = false, fromHere = false, waits = false, noReport = false, noPriority = false, details = false;
};

/** A square that a phone's camera reads. */
void drawCode(const std::string& text) {
    const std::unique_ptr<QRcode, void (*)(QRcode*)> code(
        QRcode_encodeString(text.c_str(), 0, QR_ECLEVEL_L, QR_MODE_8, 1), QRcode_free);
    if (!code) return;
    constexpr int kEdge = 2;
    const auto isDark = [&](int x, int y) {
        return x >= 0 && y >= 0 && x < code->width && y < code->width && (code->data[y * code->width + x] & 1) != 0;
    };
    for (int y = -kEdge; y < code->width + kEdge; y += 2) {  // two of its rows per line, light on dark terminals, too
        std::printf("\033[30;47m");
        for (int x = -kEdge; x < code->width + kEdge; ++x)
            std::printf("%s",
                        isDark(x, y) ? (isDark(x, y + 1) ? "\u2588" : "\u2580") : (isDark(x, y + 1) ? "\u2584" : " "));
        std::printf("\033[0m\n");
    }
}

/** The page of a live arm: its server, and what it is told. */
class LivePage {
public:
    LivePage(PageOptions options, LiveSession& session, const CasePlan& plan, const std::string& title,
             bool movesJoints)
        : hand_(session.hand()), placed_(session.placed()) {
        options.certificate = readOrMakeCertificate(findKeyFolder(), listHosts(options.address));
        options.page = readWhole(findShared(kLivePage)).value_or("");
        if (options.page.empty())
            throw badInput(findShared(kLivePage).string(), "the page of live arms is missing",
                           "Run tools/setup.sh again, or install viable again.");
        if (hand_ && movesJoints) options.joints = plan.robot.size();
        if (placed_) options.place = [this](const std::string& message) { return placed_->request(message); };
        options.channels = std::make_shared<const FoxgloveChannels>(session.layout(), title);
        isOpenToOthers_ = options.address != "127.0.0.1" && options.address != "::1";
        fingerprint_ = options.certificate.fingerprint;
        server_ = std::make_unique<PageServer>(std::move(options), hand_, [&session](PageWish wish) {
            if (wish == PageWish::Start) session.resume(LiveAsker::Page);
            if (wish == PageWish::Pause) session.pause(LiveAsker::Page);
            if (wish == PageWish::Stop) session.stop(LiveAsker::Page);
            if (wish == PageWish::Record || wish == PageWish::EndRecord) session.record(wish == PageWish::Record);
        });
        server_->broadcast("live", describeLive(plan, title, hand_ != nullptr, movesJoints, placed_ != nullptr,
                                                session.layout().hasContact));
        if (placed_) server_->broadcast("placed", placed_->describe());  // a page that returns may show what never came
    }

    /** @param first  with what to know before the first visit */
    void tellAddress(bool first) {
        const std::string address = server_->makeAddress();
        std::printf("page: %s\n", address.c_str());
        const std::vector<std::string>& all = server_->publicAuthorities();
        for (std::size_t k = 1; k < all.size(); ++k)
            std::printf("  or: https://%s%s\n", all[k].c_str(), address.substr(address.find("/#")).c_str());
        if (isOpenToOthers_ && ::isatty(STDOUT_FILENO) != 0) drawCode(address);
        if (first) {
            std::printf(
                "      It lets one browser in. The browser does not know this computer's certificate and warns: choose "
                "\"Advanced\", then\n      \"Proceed\". The certificate's SHA-256 is %s\n",
                fingerprint_.c_str());
            std::printf("watch: %s\n      For Foxglove or Lichtblick, which see the arm there and cannot move it.\n",
                        server_->watchAddress().c_str());
            if (isOpenToOthers_)
                std::fprintf(stderr,
                             "the page can be reached from other computers; who has such an address moves the arm\n");
        }
        std::fflush(stdout);
    }

    void broadcast(const LiveEvent& event) {
        server_->broadcast(
            "event",
            nlohmann::json{{"event", getName(event.state)}, {"asker", getName(event.asker)}, {"time_s", event.time_s}}
                .dump());
    }

    /** @param isNew  there has been a tick since the last call */
    void show(const LiveStatus& status, bool isNew) {
        if (status.record.nominal.q.size() == 0) return;  // no tick yet
        if (isNew) server_->stream(status.record);
        if (placed_ && placed_->look(status.time_s)) server_->broadcast("placed", placed_->describe());
        server_->show(encodeFrame(hand_ ? hand_->now() : 0.0, status, hand_ ? &hand_->status() : nullptr));
    }

private:
    const std::shared_ptr<TeleoperationFeed> hand_;
    PlacedObstacles* const placed_;
    std::unique_ptr<PageServer> server_;
    std::string fingerprint_;
    bool isOpenToOthers_ = false;
};

/** Shows how the arm is, in a thread of its own: an output that does not take it must not keep keys and signals waiting. */
class Display {
public:
    Display(LiveSession& session, std::vector<std::string> jointNames)
        : session_(session), names_(std::move(jointNames)), isTerminal_(::isatty(STDOUT_FILENO) != 0) {
        show(session.status());
        thread_ = std::thread([this] { work(); });
    }
    /** Waits until all has been shown. */
    ~Display() {
        isDone_ = true;
        thread_.join();
    }
    /** How the arm is now. By one thread. */
    void show(const LiveStatus& status) { latest_.write(status); }

private:
    void work() {
        for (bool isLast = false; !isLast;) {
            isLast = isDone_;
            tellEvents();
            draw();
            if (!isLast) std::this_thread::sleep_for(std::chrono::milliseconds(kLook_ms));
        }
        clear();
    }

    void tellEvents() {
        LiveEvent event;
        for (; session_.getEvent(told_, event); ++told_) {
            clear();
            std::printf("%10.3f s  %s (%s)\n", event.time_s, getName(event.state), getName(event.asker));
            std::fflush(stdout);
        }
    }

    void clear() {
        if (isDrawn_) std::printf("\r\033[K");
        isDrawn_ = false;
    }

    void draw() {
        const auto now = std::chrono::steady_clock::now();
        const double period_s = isTerminal_ ? kTerminalLine_s : kPlainLine_s;
        if (std::chrono::duration<double>(now - drawn_).count() < period_s || session_.hasEnded()) return;
        drawn_ = now;
        const LiveStatus& status = latest_.read();
        clear();
        std::string acting;
        for (Eigen::Index i = 0; i < status.record.nominal.q.size(); ++i) {
            const JointIntervention& joint = status.record.joints[i];
            if (joint.limit == LimitKind::None) continue;
            detail::addItem(acting, names_[i] + " " + getName(joint.limit, joint.side));
        }
        std::printf("%10.3f s  %s, command at %.3f s, missed ticks %lld, slowest tick %.0f us%s%s%s", status.time_s,
                    getName(status.state), status.commandTime_s, static_cast<long long>(status.missed),
                    status.worstCompute_us, status.lostRows > 0 ? ", log too slow" : "",
                    acting.empty() ? "" : ", limits: ", acting.c_str());
        if (!isTerminal_) std::printf("\n");
        isDrawn_ = isTerminal_;
        std::fflush(stdout);
    }

    const LiveSession& session_;
    const std::vector<std::string> names_;
    LatestValue<LiveStatus> latest_;
    const bool isTerminal_;
    bool isDrawn_ = false;
    std::size_t told_ = 0;
    std::chrono::steady_clock::time_point drawn_{};
    std::atomic<bool> isDone_{false};
    std::thread thread_;
};

/** Makes wishes of keys and signals, and shows the arm, until all has ended. @param page  null: none */
void attend(LiveSession& session, LivePage* page, const std::vector<std::string>& jointNames) {
    LiveKeys keys;
    if (keys.exist())
        std::printf("keys: space brakes and holds, Enter goes on, q brakes and ends%s\n",
                    page ? ", a tells another address of the page" : "");
    std::fflush(stdout);
    Display display(session, jointNames);
    double shown_s = -1.0;
    std::chrono::steady_clock::time_point shown{};
    std::size_t told = 0;
    const auto tellPage = [&](const LiveStatus& status, bool isNew) {
        LiveEvent event;
        for (; session.getEvent(told, event); ++told) page->broadcast(event);
        page->show(status, isNew);
    };
    while (!session.hasEnded()) {
        if (getStopSignal() != 0) session.stop(LiveAsker::Signal);
        const char key = keys.wait(page ? kPageLook_ms : kLook_ms);
        if (key == ' ') session.pause(LiveAsker::Key);
        if (key == '\n' || key == '\r') session.resume(LiveAsker::Key);
        if (key == 'q' || key == 'Q') session.stop(LiveAsker::Key);
        if (key == 'a' && page) page->tellAddress(false);
        const LiveStatus& status = session.status();
        const auto now = std::chrono::steady_clock::now();
        const bool isNew = status.time_s != shown_s;
        if (!isNew && now - shown < std::chrono::milliseconds(kLook_ms)) continue;
        shown_s = status.time_s;
        shown = now;
        display.show(status);
        if (page) tellPage(status, isNew);
    }
    if (!page) return;
    // That it was stopped, too: a page that does not know warns of an arm that may still move.
    const LiveStatus& last = session.status();
    tellPage(last, last.time_s != shown_s);
}

Experiment readOneCase(const LiveArguments& arguments, const std::vector<std::string>& overrides,
                       const PluginLoader& loader) {
    Experiment experiment = readDrawnExperiment(arguments.file, overrides, "", loader);
    selectOneCase(experiment, arguments.caseName, "driven");
    return experiment;
}

/** The experiment with the start where the robot stands. */
Experiment readLiveExperiment(const LiveArguments& arguments, const PluginLoader& loader) {
    Experiment experiment = readOneCase(arguments, arguments.overrides, loader);
    const CasePlan& plan = experiment.cases.front();
    const std::string place = "cases." + plan.name + ".";
    std::vector<std::string> overrides = arguments.overrides;
    if (arguments.fromHere) {
        constexpr char kTolerance[] = "start_tolerance_rad";
        if (!plan.realPlant || !plan.realPlant->parameters.resolved().find(kTolerance))
            throw badInput("--from-here", "the case has no robot that stands somewhere (plant link)",
                           "Leave it out: a simulated arm stands at the file's start.");
        overrides.push_back(place + "real_plant." + kTolerance + "=.inf");
        experiment = readOneCase(arguments, overrides, loader);
        overrides.pop_back();
    }
    const std::string start = findLiveStart(experiment.cases.front());
    if (start.empty()) return experiment;
    overrides.push_back(place + "start=" + start);
    return readOneCase(arguments, overrides, loader);
}

/** A class in Python comes too late now and then, and nothing can be done about it in time. */
void refusePython(const CasePlan& plan) {
    for (const PluginChoice* choice : plan.plugins())
        if (isPython(choice->plugin))
            throw badInput(choice->parameters.resolved().find("plugin")->place(),
                           "a class in Python cannot drive an arm in real time: a call takes 20 us in the mean, and "
                           "with another busy Python thread 8 ms in the mean and 330 ms at worst",
                           "Run the case with `viable run`; for live, write it in C++ (viable new " +
                               std::string(getName(choice->plugin.kind)) +
                               " NAME), or send targets from Python to the command plugin stream.");
}

/** Before anything has moved. */
int tellEnd(int signal) {
    std::fprintf(stderr, "viable: ended by signal %d before the arm was driven\n", signal);
    return 128 + signal;
}

int goLive(const LiveArguments& arguments) {
    refuseLog(arguments.file);
    // Before a robot is called:
    if (!arguments.out.empty()) requireFreeFolder(arguments.out);
    PageOptions pageOptions;
    if (arguments.hasPage) {
        pageOptions.port = kPagePort;
        readAddress(arguments.page, pageOptions);
        requireAddress(pageOptions);
    }
    const auto processors = ::sysconf(_SC_NPROCESSORS_CONF);
    if (arguments.realTime.cpu >= processors)
        throw badInput("--cpu " + std::to_string(arguments.realTime.cpu),
                       "this computer has " + std::to_string(processors) + " processors",
                       "Name one from 0 to " + std::to_string(processors - 1) + ".");
    if (arguments.waits && !arguments.hasPage && !LiveKeys::areThere())
        throw badInput("--wait", "there is no terminal for the Enter that it waits for",
                       "Start it in the foreground of a terminal, or leave --wait out.");
    if (arguments.duration_s && std::isnan(*arguments.duration_s))
        throw badInput("--duration nan", "this is no time", "Give seconds, or inf.");
    countPluginAllocations();
    const HangWatch hangWatch(kDefaultPatience_s, getStopSignal());
    tellStage("while the experiment was read and its plugins were made", PluginsRun::Here);
    const PluginLoader loader(PluginLoader::makeDefaultSearchPath());
    ignoreWriteSignals();
    catchStopSignals();
    const Experiment experiment = readLiveExperiment(arguments, loader);
    const CasePlan& plan = experiment.cases.front();
    refusePython(plan);
    if (!plan.missedTicks.empty())
        throw badInput(plan.name, "missed_ticks are for simulated time; here the clock says which ticks were missed",
                       "Take the key out, or run the case with `viable run`.");
    LiveSession::rehearse(plan);
    std::unique_ptr<ConfiguredCase> configured = configureCase(plan);
    if (const int signal = getStopSignal()) return tellEnd(signal);
    const bool movesJoints = configured->plugins.command->traits().space == MotionCommand::Space::Joint;

    const fs::path folder = makeRunFolder(arguments.out, arguments.file);
    const FolderClaim claim(folder);
    installCrashHandler(folder);
    tellStage("while the arm was driven", PluginsRun::Here);
    LiveOptions options;
    options.log.file = folder / (plan.name + ".mcap");
    options.log.limit_bytes = static_cast<std::uint64_t>(arguments.logLimit_MB * 1e6);
    options.realTime = arguments.realTime;
    if (arguments.noPriority) options.realTime = {-1, 0, false};
    options.waitsArmed = arguments.waits || arguments.hasPage;
    options.duration_s = arguments.duration_s.value_or(plan.duration_s);
    options.prepareThread = prepareThreadForCrash;
    LiveSession session(std::move(configured), options);
    std::printf("%s\n%s, case %s, output in %s\n", makePrintable(experiment.title).c_str(), arguments.file.c_str(),
                plan.name.c_str(), folder.c_str());
    std::fflush(stdout);
    if (const int signal = getStopSignal()) return tellEnd(signal);
    std::unique_ptr<LivePage> page;
    if (arguments.hasPage) {
        page = std::make_unique<LivePage>(std::move(pageOptions), session, plan, experiment.title, movesJoints);
        page->tellAddress(true);
    }
    session.begin();
    for (const std::string& refusal : session.timing().refusals)
        std::fprintf(stderr, "%s: %s\n", session.timing().isRealTime ? "real time, but" : "not real time",
                     refusal.c_str());
    try {
        attend(session, page.get(), plan.robot.jointNames());
    } catch (...) {
        session.stop(LiveAsker::Program);  // before the page says goodbye to its viewers, which takes time
        throw;
    }
    page.reset();
    std::vector<CaseResult> results;
    results.push_back(session.finish());
    tellStage("while summary and report were written", PluginsRun::NoMore);
    int code = tellResults(results, arguments.details);
    if (const int lost = tryWriteSummary(folder, experiment, results); code == 0) code = lost;
    if (arguments.noReport)
        std::printf("for a report: viable report %s\n", folder.c_str());
    else if (!tryWriteReport(folder) && code == 0)
        code = static_cast<int>(ErrorKind::LogNotWritten);
    const int signal = getStopSignal();
    return code == 0 && signal != 0 ? 128 + signal : code;
}

}  // namespace

void addLiveCommand(CLI::App& app, int& exitCode) {
    auto arguments = std::make_shared<LiveArguments>();
    CLI::App* command =
        app.add_subcommand("live", "Drive a case's arm in real time, by the robot's clock or this computer's");
    command->add_option("FILE", arguments->file, "Experiment file")->required();
    command->add_option("--case", arguments->caseName, "The case, where the file has several");
    command->add_option("--set", arguments->overrides, "key.path=value, replaces an entry of the file")
        ->allow_extra_args(false);
    command
        ->add_option(
            "--duration", arguments->duration_s,
            "Seconds of the command's time, then the arm brakes (default: the file's; inf: until it is told to)")
        ->check(CLI::Range(0.0, std::numeric_limits<double>::infinity()));
    command->add_flag("--from-here", arguments->fromHere,
                      "Start where the robot stands, however far that is from the file's start");
    command->add_flag("--wait", arguments->waits, "Hold the arm until Enter is pressed, before the command begins");
    CLI::Option* const page =
        command
            ->add_option("--page", arguments->page,
                         "Show the arm on a page, and let a hand move it (command teleoperation), at ADDRESS:PORT "
                         "(default: 127.0.0.1:8484, for this computer alone). The arm waits for the page's start")
            ->expected(0, 1);
    command->add_option("--cpu", arguments->realTime.cpu, "Run the loop on this processor alone")
        ->check(CLI::Range(0, 4095));
    command->add_option("--priority", arguments->realTime.priority, "Of the loop's thread, SCHED_FIFO (default: 80)")
        ->check(CLI::Range(1, 98));
    command
        ->add_flag("--no-priority", arguments->noPriority, "Ask the system for nothing: no priority, no locked memory")
        ->excludes("--cpu", "--priority");
    command->add_option("--out", arguments->out, "Folder for log, summary and report (default: a new one in ./runs)");
    command
        ->add_option("--log-limit", arguments->logLimit_MB,
                     "Megabytes that the log may take; of a longer one the oldest parts but the first are deleted "
                     "(default: 4096)")
        ->check(CLI::Range(16.0, 1e9));
    command->add_flag("--no-report", arguments->noReport, "Log and summary only");
    command->add_flag("--details", arguments->details, "Print the whole account of the case at its end");
    command->callback([arguments, page, &exitCode] {
        arguments->hasPage = page->count() > 0;
        exitCode = goLive(*arguments);
    });
}

}  // namespace viable
