#pragma once

#include "log/LogFields.h"

namespace viable {

/** What a server of the Foxglove WebSocket protocol, version 1, says of a run: the channels of its log with their schemas
(ros2msg, CDR), to be looked at and no more. Source: https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md */
class FoxgloveChannels {
public:
    FoxgloveChannels(const LogLayout& layout, const std::string& name);

    /** The protocol's name to answer with, of those that a client names ("a, b"); empty: none that is spoken here. Programs of
    2025 and later ask for foxglove.sdk.v1, whose messages are the same. */
    static std::string choose(const std::string& protocols);

    /** The two messages that a client begins with. */
    const std::string& serverInfo() const { return serverInfo_; }
    const std::string& advertisement() const { return advertisement_; }

    std::size_t size() const { return channels_.size(); }
    /** The data of a message. @param channel  below size() */
    std::string encode(std::size_t channel, const TickRecord& record) const;

private:
    std::vector<const LogChannel*> channels_;
    const int joints_;
    std::string serverInfo_, advertisement_;
};

/** What one client has subscribed to. */
class FoxgloveClient {
public:
    static constexpr std::size_t kMostSubscriptions = 256;

    explicit FoxgloveClient(const FoxgloveChannels& channels) : channels_(channels) {}

    /** Takes a message (JSON). False: it is refused, as a whole; `answer` is then what to tell the client. */
    bool onText(const std::string& message, std::string& answer);

    bool isListening() const { return !subscriptions_.empty(); }
    /** The binary messages of a row, one for each subscription. */
    std::vector<std::string> makeMessages(const TickRecord& record) const;

private:
    const FoxgloveChannels& channels_;
    std::map<std::uint32_t, std::size_t> subscriptions_;  // to channels
};

}  // namespace viable
