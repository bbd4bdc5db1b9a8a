#include "page/Foxglove.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "log/LogMessage.h"

namespace viable {

using nlohmann::json;

constexpr char kProtocols[][24] = {"foxglove.websocket.v1", "foxglove.sdk.v1"};
constexpr std::uint8_t kMessageData = 1;
constexpr int kStatusError = 2;

static std::string dump(const json& text) {
    return text.dump(-1, ' ', false, json::error_handler_t::replace);
}

/** A whole number of 32 bits. */
static std::optional<std::uint32_t> readId(const json& number) {
    if (!number.is_number_unsigned() || number.get<std::uint64_t>() > 0xffffffffu) return {};
    return number.get<std::uint32_t>();
}

FoxgloveChannels::FoxgloveChannels(const LogLayout& layout, const std::string& name)
    : joints_(static_cast<int>(layout.jointNames.size())) {
    serverInfo_ = dump({{"op", "serverInfo"},
                        {"name", name},
                        {"capabilities", json::array()},
                        {"supportedEncodings", json::array()},
                        {"metadata", {{"joint_names", dump(json(layout.jointNames))}}}});
    json advertised = json::array();
    for (const LogChannel* channel : listLogChannels()) {
        if (!channel->isLogged(layout)) continue;
        advertised.push_back({{"id", channels_.size()},
                              {"topic", channel->getTopic()},
                              {"encoding", "cdr"},
                              {"schemaName", channel->getSchema()},
                              {"schemaEncoding", "ros2msg"},
                              {"schema", channel->getSchemaText()}});
        channels_.push_back(channel);
    }
    advertisement_ = dump({{"op", "advertise"}, {"channels", advertised}});
}

std::string FoxgloveChannels::choose(const std::string& protocols) {
    for (const char* own : kProtocols) {
        for (std::size_t begin = 0; begin < protocols.size();) {
            const std::size_t end = std::min(protocols.find(',', begin), protocols.size());
            const std::size_t first = std::min(protocols.find_first_not_of(' ', begin), end);
            if (protocols.substr(first, protocols.find_last_not_of(' ', end - 1) + 1 - first) == own) return own;
            begin = end + 1;
        }
    }
    return {};
}

std::string FoxgloveChannels::encode(std::size_t channel, const TickRecord& record) const {
    mcap::ByteWriter out;
    putMessage(*channels_[channel], record, joints_, out);
    return std::move(out.bytes);
}

bool FoxgloveClient::onText(const std::string& message, std::string& answer) {
    const auto refuse = [&](const std::string& reason) {
        answer = dump({{"op", "status"}, {"level", kStatusError}, {"message", reason}});
        return false;
    };
    const json parsed = json::parse(message, nullptr, false);
    if (!parsed.is_object() || !parsed.contains("op") || !parsed["op"].is_string()) return refuse("no message");
    const auto find = [&](const char* key) -> const json* {
        const auto found = parsed.find(key);
        return found != parsed.end() && found->is_array() ? &*found : nullptr;
    };
    std::map<std::uint32_t, std::size_t> wanted = subscriptions_;
    if (parsed["op"] == "subscribe") {
        const json* all = find("subscriptions");
        if (!all) return refuse("subscribe without subscriptions");
        for (const json& one : *all) {
            const auto id = one.is_object() && one.contains("id") ? readId(one["id"]) : std::nullopt;
            const auto channel = id && one.contains("channelId") ? readId(one["channelId"]) : std::nullopt;
            if (!channel) return refuse("a subscription has whole numbers id and channelId");
            if (*channel >= channels_.size()) return refuse("there is no channel " + std::to_string(*channel));
            if (!wanted.emplace(*id, *channel).second)
                return refuse("subscription " + std::to_string(*id) + " is there already");
            if (wanted.size() > kMostSubscriptions) return refuse("too many subscriptions");
        }
    } else if (parsed["op"] == "unsubscribe") {
        const json* all = find("subscriptionIds");
        if (!all) return refuse("unsubscribe without subscriptionIds");
        for (const json& one : *all) {
            const auto id = readId(one);
            if (!id || wanted.erase(*id) == 0) return refuse("there is no such subscription");
        }
    } else {
        return refuse("not offered here: a live arm can be watched, and no more");
    }
    subscriptions_.swap(wanted);
    return true;
}

std::vector<std::string> FoxgloveClient::makeMessages(const TickRecord& record) const {
    std::vector<std::string> messages;
    std::map<std::size_t, std::string> data;
    const std::uint64_t time = toLogTime(record.time_s);
    for (const auto& [id, channel] : subscriptions_) {
        std::string& body = data[channel];
        if (body.empty()) body = channels_.encode(channel, record);
        mcap::ByteWriter out;
        out.putU8(kMessageData);
        out.putU32(id);
        out.putU64(time);
        out.bytes += body;
        messages.push_back(std::move(out.bytes));
    }
    return messages;
}

}  // namespace viable
