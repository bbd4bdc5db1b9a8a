#include <cmath>
#include <cstring>
#include <sstream>

#include "RobotFolder.h"
#include "draft/RobotDraft.h"
#include "meshes/RobotShapes.h"

namespace viable {
namespace {

using Eigen::Vector3d;

/** The body of all files: a box off its frame's origin, so that no turn and no mirror leaves it where it is. [m] */
const Vector3d kCenter(0.1, 0.2, 0.3);
const Vector3d kEdges(0.3, 0.1, 0.05);

std::vector<Vector3d> listBodyCorners() {
    std::vector<Vector3d> corners;
    for (int k = 0; k < 8; ++k)
        corners.push_back(kCenter +
                          0.5 * kEdges.cwiseProduct(Vector3d(k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1)));
    return corners;
}

using Triangle = std::array<unsigned, 3>;

/** Counterclockwise, seen from outside. */
const std::vector<Triangle> kTriangles{{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                                       {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};

std::string format(const Vector3d& p) {
    std::ostringstream text;
    text.precision(9);
    text << p.x() << ' ' << p.y() << ' ' << p.z();
    return text.str();
}

template <class Number>
void append(std::string& bytes, Number value) {
    char raw[sizeof value];
    std::memcpy(raw, &value, sizeof value);
    bytes.append(raw, sizeof value);
}

void appendPoint(std::string& bytes, const Vector3d& p) {
    for (int k = 0; k < 3; ++k) append(bytes, static_cast<float>(p[k]));
}

std::string writeTextStl() {
    const std::vector<Vector3d> corners = listBodyCorners();
    std::string text = "solid body\n";
    for (const Triangle& t : kTriangles) {
        text += "facet normal 0 0 0\nouter loop\n";
        for (const unsigned i : t) text += "vertex " + format(corners[i]) + "\n";
        text += "endloop\nendfacet\n";
    }
    return text + "endsolid body\n";
}

std::string writeBinaryStl() {
    const std::vector<Vector3d> corners = listBodyCorners();
    std::string bytes(80, ' ');
    append(bytes, static_cast<std::uint32_t>(kTriangles.size()));
    for (const Triangle& t : kTriangles) {
        appendPoint(bytes, Vector3d::Zero());  // no normal
        for (const unsigned i : t) appendPoint(bytes, corners[i]);
        append(bytes, std::uint16_t{0});
    }
    return bytes;
}

std::string writeObj() {
    std::string text;
    for (const Vector3d& p : listBodyCorners()) text += "v " + format(p) + "\n";
    for (const Triangle& t : kTriangles) {
        text += "f";
        for (const unsigned i : t) text += " " + std::to_string(i + 1);
        text += "\n";
    }
    return text;
}

std::string writePly(bool isBinary) {
    std::string bytes = std::string("ply\nformat ") + (isBinary ? "binary_little_endian" : "ascii") +
                        " 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
                        "element face 12\nproperty list uchar int vertex_indices\nend_header\n";
    for (const Vector3d& p : listBodyCorners()) {
        if (isBinary)
            appendPoint(bytes, p);
        else
            bytes += format(p) + "\n";
    }
    for (const Triangle& t : kTriangles) {
        if (isBinary)
            append(bytes, std::uint8_t{3});
        else
            bytes += "3";
        for (const unsigned i : t) {
            if (isBinary)
                append(bytes, static_cast<std::int32_t>(i));
            else
                bytes += " " + std::to_string(i);
        }
        if (!isBinary) bytes += "\n";
    }
    return bytes;
}

/** A node of a file: x in its parent's frame = translation + R_z(angle) (scale * x in its own). */
struct Node {
    Vector3d translation;
    double angle;  ///< [rad], about z
    double scale;

    Vector3d undo(const Vector3d& p) const {
        return Eigen::AngleAxisd(-angle, Vector3d::UnitZ()) * (p - translation) / scale;
    }
    Eigen::Matrix4d getMatrix() const {
        Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
        matrix.topLeftCorner<3, 3>() = scale * Eigen::AngleAxisd(angle, Vector3d::UnitZ()).toRotationMatrix();
        matrix.topRightCorner<3, 1>() = translation;
        return matrix;
    }
};

const Node kOuter{Vector3d(0.5, -0.3, 0.2), 0.7, 2.0};
const Node kInner{Vector3d(-0.1, 0.4, 0.6), -1.9, 0.25};

std::string writeCollada(const std::string& up, double unit) {
    // Unit and the nodes' frames are undone in the points.
    std::string points;
    for (const Vector3d& p : listBodyCorners()) points += format(kInner.undo(kOuter.undo(p / unit))) + " ";
    std::string triangles;
    for (const Triangle& t : kTriangles)
        for (const unsigned i : t) triangles += std::to_string(i) + " ";
    std::ostringstream matrix;
    matrix.precision(12);
    for (int row = 0; row < 4; ++row)
        for (int column = 0; column < 4; ++column) matrix << kInner.getMatrix()(row, column) << ' ';
    std::ostringstream text;
    text.precision(12);
    text << "<?xml version='1.0'?><COLLADA xmlns='http://www.collada.org/2005/11/COLLADASchema' version='1.4.1'>"
            "<asset><unit name='own' meter='"
         << unit << "'/><up_axis>" << up
         << "</up_axis></asset><library_geometries><geometry id='g'><mesh><source id='p'>"
            "<float_array id='a' count='24'>"
         << points
         << "</float_array><technique_common><accessor source='#a' count='8' stride='3'>"
            "<param name='X' type='float'/><param name='Y' type='float'/><param name='Z' type='float'/></accessor>"
            "</technique_common></source><vertices id='v'><input semantic='POSITION' source='#p'/></vertices>"
            "<triangles count='12'><input semantic='VERTEX' source='#v' offset='0'/><p>"
         << triangles
         << "</p></triangles></mesh></geometry></library_geometries><library_visual_scenes><visual_scene id='s'>"
            "<node id='outer'><translate>"
         << format(kOuter.translation) << "</translate><rotate>0 0 1 " << kOuter.angle * 180.0 / EIGEN_PI
         << "</rotate><scale>" << kOuter.scale << ' ' << kOuter.scale << ' ' << kOuter.scale
         << "</scale><node id='inner'><matrix>" << matrix.str()
         << "</matrix><instance_geometry url='#g'/></node></node></visual_scene></library_visual_scenes>"
            "<scene><instance_visual_scene url='#s'/></scene></COLLADA>\n";
    return text.str();
}

std::string toBase64(const std::string& bytes) {
    const char* const digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
        unsigned block = 0;
        for (std::size_t k = 0; k < 3; ++k)
            block = block << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
        for (std::size_t k = 0; k < 4; ++k) text += i + k <= bytes.size() ? digits[block >> (18 - 6 * k) & 63] : '=';
    }
    return text;
}

/** Points as glTF has them, and their triangles. */
std::string makeGltfBuffer(bool hasNodes) {
    std::string bytes;
    for (const Vector3d& p : listBodyCorners()) {
        const Vector3d yUp(p.x(), p.z(), -p.y());
        appendPoint(bytes, hasNodes ? kInner.undo(kOuter.undo(yUp)) : yUp);
    }
    for (const Triangle& t : kTriangles)
        for (const unsigned i : t) append(bytes, static_cast<std::uint16_t>(i));
    return bytes;
}

/** @param uri  that of the buffer, empty: the file's own binary part */
std::string makeGltf(const std::string& uri, bool hasNodes) {
    std::ostringstream text;
    text.precision(12);
    text << R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[)";
    if (hasNodes) {
        text << R"({"children":[1],"translation":[)" << kOuter.translation.x() << ',' << kOuter.translation.y() << ','
             << kOuter.translation.z() << R"(],"rotation":[0,0,)" << std::sin(0.5 * kOuter.angle) << ','
             << std::cos(0.5 * kOuter.angle) << R"(],"scale":[)" << kOuter.scale << ',' << kOuter.scale << ','
             << kOuter.scale << R"(]},{"mesh":0,"matrix":[)";
        const Eigen::Matrix4d matrix = kInner.getMatrix();
        for (int k = 0; k < 16; ++k) text << (k ? "," : "") << matrix(k % 4, k / 4);  // by columns
        text << "]}";
    } else {
        text << R"({"mesh":0})";
    }
    text << R"(],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],"buffers":[{)"
         << (uri.empty() ? "" : R"("uri":")" + uri + R"(",)")
         << R"("byteLength":168}],"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":96},)"
         << R"({"buffer":0,"byteOffset":96,"byteLength":72}],"accessors":[{"bufferView":0,"componentType":5126,)"
         << R"("count":8,"type":"VEC3","min":[-9,-9,-9],"max":[9,9,9]},)"
         << R"({"bufferView":1,"componentType":5123,"count":36,"type":"SCALAR"}]})";
    return text.str();
}

std::string writeGltf(bool hasNodes) {
    return makeGltf("data:application/octet-stream;base64," + toBase64(makeGltfBuffer(hasNodes)), hasNodes);
}

std::string writeGlb() {
    std::string text = makeGltf("", true);
    text.resize((text.size() + 3) / 4 * 4, ' ');
    const std::string buffer = makeGltfBuffer(true);
    std::string bytes = "glTF";
    append(bytes, std::uint32_t{2});
    append(bytes, static_cast<std::uint32_t>(12 + 8 + text.size() + 8 + buffer.size()));
    append(bytes, static_cast<std::uint32_t>(text.size()));
    bytes += "JSON" + text;
    append(bytes, static_cast<std::uint32_t>(buffer.size()));
    return bytes + std::string("BIN\0", 4) + buffer;
}

struct MeshCase {
    const char* name;
    const char* file;
    std::function<std::string()> write;
    double scale = 1.0;  ///< in the URDF
};

/** The body as an arm's link: as `geometry`, or as a file of the folder. */
struct BodyArm {
    explicit BodyArm(const std::string& geometry) {
        makeSimpleArm(folder);
        const std::string shape = "<geometry>" + geometry + "</geometry>";
        RobotFolder::replace(folder.urdf, "<link name='upper'>",
                             "<link name='upper'><visual>" + shape + "</visual><collision>" + shape + "</collision>");
        folder.write();
    }
    DraftLink draft() const { return readRobotDraft(folder.path() / "arm.urdf").links.at(1); }
    RobotFolder folder;
};

DraftCapsule draftPrimitive() {
    BodyArm arm("<box size='" + format(kEdges) + "'/>");
    RobotFolder::replace(arm.folder.urdf, "<collision>",
                         "<collision><origin xyz='" + format(kCenter) + "' rpy='0 0 0'/>");
    arm.folder.write();
    return arm.draft().capsules.at(0);
}

class Fault79MeshFormats : public ::testing::TestWithParam<MeshCase> {};

TEST_P(Fault79MeshFormats, OneBodyIsTheSameInAll) {
    const MeshCase& one = GetParam();
    BodyArm arm("<mesh filename='" + std::string(one.file) + "'/>");
    arm.folder.put(one.file, one.write());

    // The draft's capsules: those of the primitive.
    const DraftLink drafted = arm.draft();
    ASSERT_EQ(drafted.capsules.size(), 1u);
    const DraftCapsule expected = draftPrimitive();
    const DraftCapsule& found = drafted.capsules[0];
    const bool isTurned = (found.from - expected.from).norm() > (found.to - expected.from).norm();
    EXPECT_LT((found.from - (isTurned ? expected.to : expected.from)).norm(), 1e-3);
    EXPECT_LT((found.to - (isTurned ? expected.from : expected.to)).norm(), 1e-3);
    EXPECT_NEAR(found.radius, expected.radius, 1e-3);

    // The pictures' triangles: each corner is one of the body's, the surface is closed and looks outwards.
    const std::vector<LinkShapes> all = loadShapes(loadRobot(arm.folder.path()));
    ASSERT_EQ(all.size(), 1u);
    ASSERT_EQ(all[0].shapes.size(), 1u);
    const detail::Mesh& mesh = all[0].shapes[0].triangles;
    ASSERT_EQ(mesh.indices.size(), 3 * kTriangles.size());
    const std::vector<Vector3d> corners = listBodyCorners();
    std::vector<int> used(corners.size(), 0);
    double volume = 0.0;
    for (std::size_t i = 0; i < mesh.indices.size(); i += 3) {
        std::array<Vector3d, 3> at;
        for (std::size_t k = 0; k < 3; ++k) {
            const float* p = &mesh.positions.at(3 * mesh.indices[i + k]);
            at[k] = Vector3d(p[0], p[1], p[2]);
            std::size_t nearest = 0;
            for (std::size_t c = 1; c < corners.size(); ++c)
                if ((corners[c] - at[k]).norm() < (corners[nearest] - at[k]).norm()) nearest = c;
            EXPECT_LT((corners[nearest] - at[k]).norm(), 1e-6);
            ++used[nearest];
        }
        volume += (at[0] - kCenter).dot((at[1] - kCenter).cross(at[2] - kCenter)) / 6.0;
    }
    for (const int count : used) EXPECT_GT(count, 0);
    EXPECT_NEAR(volume, kEdges.prod(), 1e-7);
}

INSTANTIATE_TEST_SUITE_P(
    Formats, Fault79MeshFormats,
    ::testing::Values(MeshCase{"StlText", "body.stl", &writeTextStl},
                      MeshCase{"StlBinary", "body.STL", &writeBinaryStl}, MeshCase{"Obj", "body.obj", &writeObj},
                      MeshCase{"PlyText", "body.ply", [] { return writePly(false); }},
                      MeshCase{"PlyBinary", "body.ply", [] { return writePly(true); }},
                      MeshCase{"DaeZUpMetres", "body.dae", [] { return writeCollada("Z_UP", 1.0); }},
                      MeshCase{"DaeYUpMillimetres", "body.dae", [] { return writeCollada("Y_UP", 0.001); }},
                      MeshCase{"DaeXUpInches", "body.dae", [] { return writeCollada("X_UP", 0.0254); }},
                      MeshCase{"Gltf", "body.gltf", [] { return writeGltf(false); }},
                      MeshCase{"GltfNodes", "body.gltf", [] { return writeGltf(true); }},
                      MeshCase{"GlbNodes", "body.glb", &writeGlb}),
    [](const auto& one) { return std::string(one.param.name); });

TEST(Fault79, AScaleIsAlongTheLinksAxes) {
    BodyArm arm("<mesh filename='body.glb' scale='1 2 3'/>");
    arm.folder.put("body.glb", writeGlb());
    const detail::Mesh mesh = loadShapes(loadRobot(arm.folder.path())).at(0).shapes.at(0).triangles;
    Vector3d middle = Vector3d::Zero();
    for (std::size_t i = 0; i < mesh.positions.size(); ++i)
        middle[static_cast<int>(i % 3)] += mesh.positions[i] / (static_cast<double>(mesh.positions.size()) / 3.0);
    EXPECT_LT((middle - kCenter.cwiseProduct(Vector3d(1, 2, 3))).norm(), 1e-6);
}

TEST(Fault79, AMeshOfAnotherFormatIsNotGuessed) {
    const std::string body = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";  // assimp reads it
    BodyArm arm("<mesh filename='body.off'/>");
    arm.folder.put("body.off", body);
    EXPECT_EQ(arm.draft().lostMeshes, std::vector<std::string>{"body.off"});
    const LinkShapes link = loadShapes(loadRobot(arm.folder.path())).at(0);
    EXPECT_TRUE(link.shapes.empty());
    EXPECT_TRUE(link.lostMeshes.at(0).isThere);
}

}  // namespace
}  // namespace viable
