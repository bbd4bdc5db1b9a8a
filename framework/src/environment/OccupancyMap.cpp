#include "environment/OccupancyMap.h"

#include <octomap/OcTree.h>

#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <istream>
#include <streambuf>

#include "config/ConfigText.h"
#include "core/Sha256.h"
#include "core/Text.h"

namespace viable {

namespace {

namespace fs = std::filesystem;

constexpr int kDepth = 16;  ///< levels below the root of OctoMap's trees
constexpr double kLeastResolution_m = 1e-3;
constexpr double kMostResolution_m = 10.0;

constexpr std::string_view kBinaryHeader = "# Octomap OcTree binary file";
constexpr std::string_view kFullHeader = "# Octomap OcTree file";

const char* const kRemedy = "Get the file anew from where it came, or write it anew with OctoMap.";

std::string readBytes(const fs::path& file) {
    std::error_code failed;
    const bool isFile = fs::is_regular_file(file, failed);
    const std::uintmax_t size = isFile ? fs::file_size(file, failed) : 0;
    if (!isFile || failed) throw badInput(file.string(), "cannot be read", "Name a map file.");
    if (size > OccupancyMap::kMaxBytes)
        throw badInput(
            file.string(),
            "the map has " + std::to_string(size) + " bytes, more than " + std::to_string(OccupancyMap::kMaxBytes),
            "Cut the map to the room around the arm, or make its cells larger.");
    std::ifstream stream(file, std::ios::binary);
    std::string bytes(size, '\0');
    stream.read(bytes.data(), static_cast<std::streamsize>(size));
    if (!stream) throw badInput(file.string(), "cannot be read", "Check its permissions.");
    return bytes;
}

/** What stands before the nodes. */
struct Header {
    bool isBinary = false;  ///< .bt: two bits per node; else .ot: log odds
    std::uint64_t nodes = 0;
    double resolution = 0.0;  ///< [m]
    std::size_t end = 0;      ///< first byte of the nodes
};

template <class Number>
bool readNumber(std::string_view text, Number& value) {
    const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
    return result.ec == std::errc() && result.ptr == text.data() + text.size();
}

/** Stricter than OctoMap's own, which passes what it does not know. */
Header readHeader(std::string_view bytes, const std::string& place) {
    Header header;
    std::size_t position = 0;
    const auto readLine = [&]() -> std::string_view {
        constexpr std::size_t kLongest = 1000;
        const std::size_t length = bytes.substr(position, kLongest).find('\n');
        if (length == std::string_view::npos) throw badInput(place, "the header of the map is cut off", kRemedy);
        const std::string_view line = bytes.substr(position, length);
        position += length + 1;
        return line;
    };
    const auto quote = [](std::string_view text) { return detail::quoteText(std::string(text)); };
    const std::string_view first = bytes.size() < kBinaryHeader.size() ? std::string_view() : readLine();
    header.isBinary = first == kBinaryHeader;
    if (!header.isBinary && first != kFullHeader)
        throw badInput(place,
                       "is not an OctoMap file: it does not begin with `" + std::string(kFullHeader) + "` or `" +
                           std::string(kBinaryHeader) + "`",
                       "Name a .bt or .ot file of OctoMap 1.6 or later.");
    bool hasId = false, hasSize = false, hasResolution = false;
    for (std::string_view line = readLine(); line != "data"; line = readLine()) {
        if (!line.empty() && line[0] == '#') continue;
        const std::size_t space = line.find(' ');
        const std::string_view key = line.substr(0, space);
        const std::string_view value = space == std::string_view::npos ? std::string_view() : line.substr(space + 1);
        if (key == "id" && !hasId) {
            hasId = true;
            if (value != "OcTree")
                throw badInput(place, "a map of the kind " + quote(value), "Convert it to the kind OcTree.");
        } else if (key == "size" && !hasSize) {
            hasSize = true;
            if (!readNumber(value, header.nodes) || header.nodes > OccupancyMap::kMaxNodes)
                throw badInput(place,
                               "the map's number of nodes is " + quote(value) + ", allowed: 0 to " +
                                   std::to_string(OccupancyMap::kMaxNodes),
                               kRemedy);
        } else if (key == "res" && !hasResolution) {
            hasResolution = true;
            if (!readNumber(value, header.resolution) ||
                !(header.resolution >= kLeastResolution_m && header.resolution <= kMostResolution_m))
                throw badInput(place,
                               "the map's resolution is " + quote(value) +
                                   " m, allowed: " + detail::formatNumber(kLeastResolution_m) + " to " +
                                   detail::formatNumber(kMostResolution_m),
                               kRemedy);
        } else {
            throw badInput(place, "a header line that no map has there: " + quote(line), kRemedy);
        }
    }
    if (!hasId || !hasSize || !hasResolution)
        throw badInput(place, "the map's header lacks one of id, size and res", kRemedy);
    header.end = position;
    return header;
}

/** Walks through the nodes as OctoMap's readers will, and builds nothing. */
class NodeScan {
public:
    NodeScan(const Header& header, std::string_view body, const std::string& place)
        : header_(header), body_(body), place_(place) {}

    /** Throws unless the nodes are as many as the header says and take every byte. */
    void run() {
        if (header_.nodes > 0) {
            nodes_ = 1;
            header_.isBinary ? scanBinary(0) : scanFull(0);
        }
        if (nodes_ != header_.nodes)
            fail("its header says " + std::to_string(header_.nodes) + " nodes, it has " + std::to_string(nodes_));
        if (position_ != body_.size())
            fail("it has " + std::to_string(body_.size() - position_) + " bytes more than its nodes take");
    }

private:
    [[noreturn]] void fail(const std::string& what) const {
        throw badInput(place_, "the map is damaged: " + what, kRemedy);
    }
    const char* take(std::size_t count) {
        if (body_.size() - position_ < count) fail("it is cut off");
        position_ += count;
        return body_.data() + position_ - count;
    }
    void addNode(int depth) {
        if (depth > kDepth) fail("its tree is deeper than " + std::to_string(kDepth) + " levels");
        if (++nodes_ > header_.nodes)
            fail("it has more nodes than the " + std::to_string(header_.nodes) + " of its header");
    }

    /** A node with children has an array of eight pointers beside it. */
    void addInner() {
        constexpr std::uint64_t kLeafBytes = 32, kInnerBytes = 80;  // with what malloc adds
        if (kLeafBytes * nodes_ + kInnerBytes * ++inner_ > OccupancyMap::kMaxMemoryBytes)
            fail("its tree would take more than " + std::to_string(OccupancyMap::kMaxMemoryBytes >> 20) + " MiB");
    }

    /** Two bits per child: 0 unknown, 1 free, 2 occupied, 3 with children of its own, which follow in order.
    @param depth  of the node whose children these are */
    void scanBinary(int depth) {
        const char* bytes = take(2);
        const unsigned kinds =
            static_cast<unsigned char>(bytes[0]) | static_cast<unsigned>(static_cast<unsigned char>(bytes[1])) << 8;
        if (kinds == 0) fail("a node that is said to have children has none");
        addInner();
        for (int i = 0; i < 8; ++i)
            if ((kinds >> (2 * i) & 3u) != 0) addNode(depth + 1);
        for (int i = 0; i < 8; ++i)
            if ((kinds >> (2 * i) & 3u) == 3u) scanBinary(depth + 1);
    }

    /** Log odds as a float, then a byte that says which children follow. */
    void scanFull(int depth) {
        float logOdds;
        std::memcpy(&logOdds, take(sizeof logOdds), sizeof logOdds);
        // OctoMap takes what is NaN for free.
        if (!std::isfinite(logOdds)) fail("the log odds of a node are not finite");
        const unsigned children = static_cast<unsigned char>(*take(1));
        if (children != 0) addInner();
        for (int i = 0; i < 8; ++i)
            if (children >> i & 1u) {
                addNode(depth + 1);
                scanFull(depth + 1);
            }
    }

    const Header& header_;
    std::string_view body_;
    const std::string& place_;
    std::size_t position_ = 0;
    std::uint64_t nodes_ = 0, inner_ = 0;
};

/** Reads from memory without a copy. */
class MemoryBuffer : public std::streambuf {
public:
    explicit MemoryBuffer(std::string_view bytes) {
        char* begin = const_cast<char*>(bytes.data());  // streambuf's interface; never written
        setg(begin, begin, begin + bytes.size());
    }
    std::size_t left() const { return static_cast<std::size_t>(egptr() - gptr()); }
};

struct Bounds {
    Eigen::Vector3d lower, upper;
    bool touches(const Eigen::Vector3d& centre, double half) const {
        return (centre.array() + half >= lower.array()).all() && (centre.array() - half <= upper.array()).all();
    }
};

}  // namespace

struct OccupancyMap::Tree {
    explicit Tree(double resolution) : octree(resolution) {}

    octomap::OcTree octree;
    std::string sha256;

    /** @param node  null: nothing is known of the cube */
    void visit(const octomap::OcTreeNode* node, const Eigen::Vector3d& centre, double half, const Bounds& bounds,
               bool withUnknown, const std::function<void(const Cell&)>& visitor) const {
        if (!bounds.touches(centre, half)) return;
        if (!node || !octree.nodeHasChildren(node)) {
            if (node ? octree.isNodeOccupied(node) : withUnknown) visitor({centre, 2.0 * half});
            return;
        }
        for (unsigned i = 0; i < 8; ++i) {
            const bool isThere = octree.nodeChildExists(node, i);
            if (!isThere && !withUnknown) continue;
            const Eigen::Vector3d side(i & 1u ? 1.0 : -1.0, i & 2u ? 1.0 : -1.0, i & 4u ? 1.0 : -1.0);
            visit(isThere ? octree.getNodeChild(node, i) : nullptr, centre + 0.5 * half * side, 0.5 * half, bounds,
                  withUnknown, visitor);
        }
    }
};

OccupancyMap::OccupancyMap(const MapChoice& choice) {
    const std::string bytes = readBytes(choice.file);
    const std::string place = choice.file.string();
    detail::Sha256 hash;
    hash.add(bytes);
    const std::string sha256 = hash.take();
    if (!choice.sha256.empty() && choice.sha256 != sha256)
        throw badInput(choice.place,
                       "the file " + place + " is not the one that was meant: its SHA-256 is " + sha256 +
                           ", stated is " + choice.sha256,
                       "Get the right file, or state its SHA-256.");
    const Header header = readHeader(bytes, place);
    if (header.isBinary != (choice.file.extension() == ".bt"))
        throw badInput(place, std::string("the name and the content are of different kinds"),
                       std::string("Call it ") + (header.isBinary ? ".bt." : ".ot."));
    const std::string_view body = std::string_view(bytes).substr(header.end);
    NodeScan(header, body, place).run();

    tree_ = std::make_unique<Tree>(header.resolution);
    tree_->sha256 = sha256;
    MemoryBuffer buffer(body);
    std::istream stream(&buffer);
    if (header.nodes > 0) {
        if (header.isBinary)
            tree_->octree.readBinaryData(stream);
        else
            tree_->octree.readData(stream);
    }
    if (!stream || tree_->octree.size() != header.nodes || buffer.left() != 0)
        throw badInput(place, "OctoMap reads other nodes from it than it has", kRemedy);
}

OccupancyMap::~OccupancyMap() = default;
OccupancyMap::OccupancyMap(OccupancyMap&&) noexcept = default;
OccupancyMap& OccupancyMap::operator=(OccupancyMap&&) noexcept = default;

double OccupancyMap::resolution() const {
    return tree_->octree.getResolution();
}

const std::string& OccupancyMap::sha256() const {
    return tree_->sha256;
}

OccupancyMap::Occupancy OccupancyMap::getOccupancy(const Eigen::Vector3d& point) const {
    constexpr double kHalf = 1 << (kDepth - 1);  // cells from the middle to the border
    const Eigen::Array3d cell = (point.array() / resolution()).floor();
    if (!((cell >= -kHalf).all() && (cell < kHalf).all())) return Occupancy::Unknown;  // NaN, too
    octomap::OcTreeKey key;
    for (int k = 0; k < 3; ++k) key[static_cast<unsigned>(k)] = static_cast<octomap::key_type>(cell[k] + kHalf);
    const octomap::OcTreeNode* node = tree_->octree.search(key);
    if (!node) return Occupancy::Unknown;
    return tree_->octree.isNodeOccupied(node) ? Occupancy::Occupied : Occupancy::Free;
}

/** Cubes of the size of the tree's from the middle in any direction. */
constexpr double kMostCubes = 1e3;

void OccupancyMap::forEachSolidCell(const Eigen::Vector3d& lower, const Eigen::Vector3d& upper, bool withUnknown,
                                    const std::function<void(const Cell&)>& visit) const {
    VIABLE_CHECK(lower.allFinite() && upper.allFinite(), "the box has an extent");
    const Bounds bounds{lower, upper};
    const double half = resolution() * (1 << (kDepth - 1));
    const octomap::OcTreeNode* root = tree_->octree.getRoot();
    if (!withUnknown) {
        if (root) tree_->visit(root, Eigen::Vector3d::Zero(), half, bounds, false, visit);
        return;
    }
    // Space beyond the tree is unknown, too: cubes as large as the tree's, side by side.
    const Eigen::Array3d first = (lower.array() / (2.0 * half) + 0.5).floor();
    const Eigen::Array3d last = (upper.array() / (2.0 * half) + 0.5).floor();
    // Farther away than any map nothing is known, and a count of cubes has no meaning.
    if (first.abs().maxCoeff() > kMostCubes || last.abs().maxCoeff() > kMostCubes)
        return visit({0.5 * (lower + upper), (upper - lower).maxCoeff()});
    for (double x = first[0]; x <= last[0]; ++x)
        for (double y = first[1]; y <= last[1]; ++y)
            for (double z = first[2]; z <= last[2]; ++z) {
                const Eigen::Vector3d index(x, y, z);
                tree_->visit(index.isZero(0.0) ? root : nullptr, 2.0 * half * index, half, bounds, true, visit);
            }
}

}  // namespace viable
