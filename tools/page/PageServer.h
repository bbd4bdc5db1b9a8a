#pragma once

#include <atomic>
#include <thread>

#include "page/Certificate.h"
#include "page/Foxglove.h"
#include "plugin/Teleoperation.h"

namespace viable {

/** What an operator or a watcher asks for. */
enum class PageWish : unsigned char { Start, Pause, Stop, Record, EndRecord };

struct PageOptions {
    std::string address = "127.0.0.1";  ///< to listen at, numeric
    unsigned short port = 0;            ///< 0: a free one
    Certificate certificate;
    std::string page;  ///< HTML; everything is in it
    int joints = 0;    ///< numbers in a message of sliders; 0: the hand moves the tool
    /** Takes an obstacle that the operator puts somewhere (JSON); false: it is none. Empty: nobody does. */
    std::function<bool(const std::string&)> place;
    std::shared_ptr<const FoxgloveChannels> channels;  ///< for watchers with programs of their own; null: not offered
};

/** "127.0.0.1:8484", "[::1]:8484", "::1", an address or a port alone; empty: as the options are. Throws Error. */
void readAddress(const std::string& text, PageOptions& options);

/** Throws Error where no page can be opened at the address and port just now. */
void requireAddress(const PageOptions& options);

/** All host names and addresses by which a browser may call a server at that address: of networks that are up, IPv4 first; then
those of this computer alone, then names. */
std::vector<std::string> listHosts(const std::string& address);

/** One HTTPS port with the page, a WebSocket (/live), and nothing else, for watchers and one operator.

Who may: a request must name this host exactly (Host, Origin); a WebSocket needs a secret beside: a token from the address
that the program prints, which counts once, or the session that it was exchanged for. Answers: 400 malformed, 401 no such token,
403 another host or origin, 404, 405, 413 a body, 426 no WebSocket, 431 a header of more than 4 kB, 503 kMaxConnections viewers
(kMaxWatchers watchers) are there. Connections without a WebSocket are closed at once where there are kMaxStrangers already, or kMaxPerAddress of the same
address: nobody without a secret takes a viewer's place.
Words that a client may send: "alive" (each few seconds, or it is cut off), "pause" and "stop" by anyone; "take" and "take over" (the
one lease to operate), "leave"; "start", "record" and "end record" by the operator, and where there is no hand by anyone;
"invite" (an address for one more viewer); "watch" (the address for programs).
{"place": ...} by the operator, and where there is no hand by anyone: an obstacle, see PlacedObstacles. The operator's hand comes
in binary messages (see readHand). What is anything else is refused as a whole, and counted.
Watchers with programs of their own (Foxglove, Lichtblick) open the WebSocket /watch/SECRET. The secret stands in the address
because such programs send nothing else, and holds until the end, as they connect again by themselves. They come from any
origin or none: an unauthenticated page knows no secret, no browser adds one by itself, and whoever has it sees the arm and cannot
move it, as nothing but subscriptions is heard there. Host must be this one's all the same.
Messages out: text, JSON, when something has changed; binary, what show() was given last: a reader that is too slow loses some.
The end of the operator's connection or lease releases the hand, and ends what it records.
Threads: a thread of its own; what it calls must not wait. The methods by any. */
class PageServer {
public:
    static constexpr int kMaxConnections = 16;  ///< with a WebSocket
    static constexpr int kMaxStrangers = 8, kMaxPerAddress = 4, kMaxWatchers = 8;
    static constexpr std::size_t kMaxHeader = 4096;
    static constexpr double kClosing_s = 0.3;  ///< for so long the end waits for viewers to read what was told last
    /** A hand that has seen nothing newer is not followed, or (late) its engagement is over. */
    static constexpr double kOld_s = 0.2, kLate_s = 0.5;

    /** Listens from now on. Throws Error.
    @param hand  null: nobody moves the arm by hand
    @param request  handles a wish */
    PageServer(PageOptions options, std::shared_ptr<TeleoperationFeed> hand, std::function<void(PageWish)> request);
    /** Viewers get what was told and shown last, if they read it within kClosing_s. */
    ~PageServer();

    unsigned short port() const;
    /** The page's address with a token that lets one browser in. Of those that nobody used, the last 16 count; of each viewer's
    "invite" the last two. */
    std::string makeAddress();
    /** Where a watcher's own program connects; empty: not offered. */
    std::string watchAddress() const;
    /** A row for all watchers. Those that have not taken the one before lose it. */
    void stream(const TickRecord& record);
    /** By which other computers may call it, "192.168.1.2:8484"; the first is that of makeAddress(). */
    const std::vector<std::string>& publicAuthorities() const;
    /** A frame for all viewers, see LiveFrame.h. */
    void show(std::string frame);
    /** A message (JSON) for all viewers, now and when they come. `kind`: replaces the last of the same kind. */
    void broadcast(const std::string& kind, std::string message);

    struct Counts {
        std::atomic<std::int64_t> connections{0};      ///< just now
        std::atomic<std::int64_t> viewers{0};          ///< just now, with a WebSocket
        std::atomic<std::int64_t> watchers{0};         ///< just now
        std::atomic<std::int64_t> refusedRequests{0};  ///< connections and requests
        std::atomic<std::int64_t> refusedMessages{0};
        std::atomic<std::int64_t> lateHands{0};
        std::atomic<std::int64_t> hands{0};  ///< messages that went to the loop
        std::atomic<std::int64_t> lostFrames{0};
    };
    const Counts& counts() const { return counts_; }

private:
    class Impl;
    friend class Impl;
    Counts counts_;
    std::unique_ptr<Impl> impl_;
    std::thread thread_;
};

/** The message of a hand: bytes version (1), flags (1: pressed, 2: tracked), part (HandMessage::Part), joints n; uint32 number of
the press; then doubles: sent_s, echo_s (the first number of the last frame seen), scale, position xyz [m], orientation w x y z, n
joints [rad]. Little-endian. False: it is not one.
@param joints  expected
@param hand    engagement: the number of the press, 0 where it is not pressed */
bool readHand(const std::string& bytes, int joints, HandMessage& hand, double& echo_s);

}  // namespace viable
