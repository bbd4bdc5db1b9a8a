#include <hdf5.h>

#include "FullDisk.h"
#include "LogTestSupport.h"
#include "records/LogExport.h"

namespace viable::test {
namespace {

using Space = MotionCommand::Space;

struct Hdf5ExportTest : LogTestBase {
    /** run.h5 of a log run.mcap. */
    std::filesystem::path exportRun(const LogOpening& opening, const std::vector<TickRecord>& records) const {
        writeBytes(path("run.mcap"), makeLog(opening, records).bytes);
        exportHdf5(path("run.mcap"), path("run.h5"));
        return path("run.h5");
    }
};

/** An HDF5 file, read by the library. Everything is closed again at the end. */
class Hdf5File {
public:
    explicit Hdf5File(const std::filesystem::path& file) : id_(H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT)) {
        EXPECT_GE(id_, 0);
    }
    ~Hdf5File() { EXPECT_GE(H5Fclose(id_), 0); }

    std::vector<std::string> listDatasets() const {
        std::vector<std::string> paths;
        H5Lvisit(
            id_, H5_INDEX_NAME, H5_ITER_NATIVE,
            [](hid_t from, const char* name, const H5L_info_t*, void* to) -> herr_t {
                const hid_t object = H5Oopen(from, name, H5P_DEFAULT);
                if (H5Iget_type(object) == H5I_DATASET)
                    static_cast<std::vector<std::string>*>(to)->push_back("/" + std::string(name));
                return H5Oclose(object);
            },
            &paths);
        std::sort(paths.begin(), paths.end());
        return paths;
    }

    template <class T>
    std::vector<T> read(const std::string& path, hid_t type, H5T_class_t expected) const {
        const hid_t set = H5Dopen2(id_, path.c_str(), H5P_DEFAULT);
        EXPECT_GE(set, 0) << path;
        if (set < 0) return {};
        const hid_t space = H5Dget_space(set), stored = H5Dget_type(set);
        EXPECT_EQ(H5Tget_class(stored), expected) << path;
        EXPECT_EQ(H5Tget_size(stored), sizeof(T)) << path;
        EXPECT_EQ(H5Sget_simple_extent_ndims(space), 1) << path;
        std::vector<T> values(static_cast<std::size_t>(H5Sget_simple_extent_npoints(space)));
        if (!values.empty()) EXPECT_GE(H5Dread(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0) << path;
        H5Tclose(stored);
        H5Sclose(space);
        H5Dclose(set);
        return values;
    }
    std::vector<double> readNumbers(const std::string& path) const {
        return read<double>(path, H5T_NATIVE_DOUBLE, H5T_FLOAT);
    }
    std::vector<std::int64_t> readIntegers(const std::string& path) const {
        return read<std::int64_t>(path, H5T_NATIVE_INT64, H5T_INTEGER);
    }
    /** A column of words: codes, spelled out. */
    std::vector<std::string> readWords(const std::string& path) const {
        const auto codes = read<std::uint8_t>(path, H5T_NATIVE_UINT8, H5T_INTEGER);
        const std::vector<std::string> words = readTexts(path, "words");
        std::vector<std::string> spelled;
        for (const std::uint8_t code : codes)
            spelled.push_back(code < words.size() ? words[code] : "a code without a word");
        return spelled;
    }

    bool hasAttribute(const std::string& object, const std::string& name) const {
        return H5Aexists_by_name(id_, object.c_str(), name.c_str(), H5P_DEFAULT) > 0;
    }
    std::vector<std::string> readTexts(const std::string& object, const std::string& name) const {
        EXPECT_TRUE(hasAttribute(object, name)) << object << " " << name;
        if (!hasAttribute(object, name)) return {};
        const hid_t attribute = H5Aopen_by_name(id_, object.c_str(), name.c_str(), H5P_DEFAULT, H5P_DEFAULT);
        const hid_t type = H5Aget_type(attribute), space = H5Aget_space(attribute);
        EXPECT_GT(H5Tis_variable_str(type), 0) << name;
        EXPECT_EQ(H5Tget_cset(type), H5T_CSET_UTF8) << name;
        std::vector<char*> values(static_cast<std::size_t>(H5Sget_simple_extent_npoints(space)));
        std::vector<std::string> texts;
        if (!values.empty() && H5Tis_variable_str(type) > 0) {
            EXPECT_GE(H5Aread(attribute, type, values.data()), 0);
            for (const char* value : values) texts.emplace_back(value);
            H5Dvlen_reclaim(type, space, H5P_DEFAULT, values.data());
        }
        H5Sclose(space);
        H5Tclose(type);
        H5Aclose(attribute);
        return texts;
    }
    std::string readText(const std::string& object, const std::string& name) const {
        const std::vector<std::string> texts = readTexts(object, name);
        EXPECT_EQ(texts.size(), 1u);
        return texts.empty() ? "" : texts[0];
    }
    std::string readBytes(const std::string& name) const {
        const hid_t attribute = H5Aopen(id_, name.c_str(), H5P_DEFAULT);
        EXPECT_GE(attribute, 0);
        const hid_t type = H5Tvlen_create(H5T_NATIVE_UINT8), space = H5Aget_space(attribute);
        hvl_t value{0, nullptr};
        EXPECT_GE(H5Aread(attribute, type, &value), 0);
        const std::string bytes(static_cast<const char*>(value.p), value.len);
        H5Dvlen_reclaim(type, space, H5P_DEFAULT, &value);
        H5Sclose(space);
        H5Tclose(type);
        H5Aclose(attribute);
        return bytes;
    }

private:
    hid_t id_;
};

/** What the library holds open, and the process. */
std::pair<long, long> countOpen() {
    const std::filesystem::directory_iterator files("/proc/self/fd");
    return {H5Fget_obj_count(H5F_OBJ_ALL, H5F_OBJ_ALL), std::distance(files, std::filesystem::directory_iterator())};
}

bool areEqual(double a, double b) {
    return std::memcmp(&a, &b, sizeof(a)) == 0 || (std::isnan(a) && std::isnan(b));
}

TEST_F(Hdf5ExportTest, ATakeIsItsRowsAndOneThatIsNotThereLeavesNothing) {
    LogLayout layout = makeLayout(2, Space::Joint, true);
    layout.isLive = true;
    std::vector<TickRecord> records = makeRecords(layout, 9000, 0.001, 67);
    for (std::size_t i = 0; i < records.size(); ++i) records[i].take = i < 100 ? 0 : i < 8000 ? 1 : 0;
    writeBytes(path("run.mcap"), makeLog(makeOpening(layout), records).bytes);
    exportHdf5(path("run.mcap"), path("take.h5"), false, 1);
    const Hdf5File file(path("take.h5"));
    const std::vector<double> times = file.readNumbers("/time_s");
    ASSERT_EQ(times.size(), 7900u);
    EXPECT_EQ(times.front(), records[100].time_s);
    EXPECT_EQ(times.back(), records[7999].time_s);
    EXPECT_EQ(file.readIntegers("/live/take"), std::vector<std::int64_t>(7900, 1));
    expectError({"the log has no take 2. It has 1."}, [&] { exportHdf5(path("run.mcap"), path("none.h5"), false, 2); });
    EXPECT_FALSE(std::filesystem::exists(path("none.h5")));
}

TEST_F(Hdf5ExportTest, EveryValueOfEveryColumnComesBack) {
    for (const Space space : {Space::Joint, Space::Tool}) {
        LogLayout layout = makeLayout(3, space, space == Space::Joint);
        layout.jointNames = {"the \"elbow\", left", "left/arm", "joint.1"};
        // More than two blocks, so that every column grows.
        const std::vector<TickRecord> records = makeRecords(layout, 9001, 0.001, 61);
        const Hdf5File file(exportRun(makeOpening(layout), records));
        const auto expectNumbers = [&](const std::string& name, const auto& get) {
            SCOPED_TRACE(name);
            const std::vector<double> values = file.readNumbers(name);
            ASSERT_EQ(values.size(), records.size());
            for (std::size_t i = 0; i < records.size(); ++i)
                ASSERT_TRUE(areEqual(values[i], get(records[i]))) << "row " << i;
        };
        // By hand, one of each kind, so that the paths are those that users write.
        expectNumbers("/time_s", [](const TickRecord& r) { return r.time_s; });
        for (int j = 0; j < 3; ++j) {
            const std::string joint = layout.jointNames[static_cast<std::size_t>(j)];
            expectNumbers("/nominal/" + joint + "/q_rad", [&](const TickRecord& r) { return r.nominal.q[j]; });
            expectNumbers("/filter/" + joint + "/margin_rad",
                          [&](const TickRecord& r) { return r.stops[static_cast<std::size_t>(j)].margin; });
            expectNumbers("/limits/" + joint + "/jerk_upper_radps3",
                          [&](const TickRecord& r) { return r.limits.jerk.upper[j]; });
        }
        expectNumbers("/nominal/tool/x_m", [](const TickRecord& r) { return r.tool.position[0]; });
        expectNumbers("/tick/filter_us",
                      [](const TickRecord& r) { return r.stage_us[static_cast<int>(Stage::Filter)]; });
        if (space == Space::Tool)
            expectNumbers("/command/tool/wz_radps", [](const TickRecord& r) { return r.command.toolTwist[5]; });
        // And all, against the columns of the reader.
        LogReader reader(path("run.mcap"));
        EXPECT_EQ(file.listDatasets().size(), reader.columns().size());
        for (const LogColumn& column : reader.columns()) {
            SCOPED_TRACE(column.name());
            std::string name = "/" + column.name();
            if (const std::size_t first = name.find('.'); first != name.npos) name[first] = name[name.rfind('.')] = '/';
            EXPECT_EQ(file.readText(name, "column"), column.name());
            if (column.isText()) {
                const std::vector<std::string> words = file.readWords(name);
                ASSERT_EQ(words.size(), records.size());
                for (std::size_t i = 0; i < records.size(); ++i)
                    ASSERT_EQ(words[i], column.getText(records[i])) << "row " << i;
            } else if (column.isInteger()) {
                const std::vector<std::int64_t> values = file.readIntegers(name);
                ASSERT_EQ(values.size(), records.size());
                for (std::size_t i = 0; i < records.size(); ++i)
                    ASSERT_EQ(values[i], column.getInteger(records[i])) << "row " << i;
            } else {
                expectNumbers(name, [&](const TickRecord& r) { return column.getNumber(r); });
            }
        }
        std::filesystem::remove(path("run.h5"));
    }
}

/** Every column of a run with one joint: path in the file and unit; words have none. */
std::map<std::string, std::string> listUnits() {
    const struct {
        const char *folder, *unit;
        std::vector<const char*> names;
    } groups[] = {
        {"/", "s", {"time_s"}},
        {"/nominal/joint0/", "rad", {"q_rad"}},
        {"/nominal/joint0/", "rad/s", {"qd_radps"}},
        {"/nominal/joint0/", "rad/s^2", {"qdd_radps2"}},
        {"/nominal/joint0/", "rad/s^3", {"jerk_radps3"}},
        {"/nominal/tool/", "m", {"x_m", "y_m", "z_m"}},
        {"/nominal/tool/", "1", {"qx", "qy", "qz", "qw"}},
        {"/real/joint0/", "rad", {"q_rad"}},
        {"/real/joint0/", "rad/s", {"qd_radps"}},
        {"/actual/joint0/", "rad", {"q_rad"}},
        {"/actual/joint0/", "rad/s", {"qd_radps"}},
        {"/desired/joint0/", "Nm", {"tau_Nm"}},
        {"/filter/joint0/", "Nm", {"tau_Nm", "tau_removed_Nm"}},
        {"/filter/joint0/", "", {"active"}},
        {"/filter/joint0/", "rad", {"margin_rad", "rest_rad"}},
        {"/filter/joint0/", "s", {"stop_s"}},
        {"/clearance/", "1", {"known", "link", "obstacle", "other_link"}},
        {"/clearance/", "m", {"distance_m"}},
        {"/clearance/on_arm/", "m", {"x_m", "y_m", "z_m"}},
        {"/clearance/on_obstacle/", "m", {"x_m", "y_m", "z_m"}},
        {"/clearance/", "s", {"map_age_s"}},
        {"/speed/", "1", {"known", "link"}},
        {"/speed/", "m/s", {"largest_mps", "limit_mps"}},
        {"/limits/joint0/", "rad", {"position_lower_rad", "position_upper_rad"}},
        {"/limits/joint0/", "rad/s", {"velocity_lower_radps", "velocity_upper_radps"}},
        {"/limits/joint0/", "rad/s^2", {"acceleration_lower_radps2", "acceleration_upper_radps2"}},
        {"/limits/joint0/", "rad/s^3", {"jerk_lower_radps3", "jerk_upper_radps3"}},
        {"/robust/joint0/", "Nm", {"tau_Nm"}},
        {"/motor/joint0/", "Nm", {"tau_Nm"}},
        {"/command/tool/", "m", {"x_m", "y_m", "z_m"}},
        {"/command/tool/", "1", {"qx", "qy", "qz", "qw"}},
        {"/command/tool/", "m/s", {"vx_mps", "vy_mps", "vz_mps"}},
        {"/command/tool/", "rad/s", {"wx_radps", "wy_radps", "wz_radps"}},
        {"/tick/", "", {"status", "stop"}},
        {"/tick/", "1", {"braking", "missed", "substituted"}},
        {"/tick/",
         "us",
         {"compute_us", "command_us", "dynamics_us", "controller_us", "filter_us", "robust_us", "plant_us",
          "record_us"}},
    };
    std::map<std::string, std::string> units;
    for (const auto& group : groups)
        for (const char* name : group.names) units[std::string(group.folder) + name] = group.unit;
    return units;
}

TEST_F(Hdf5ExportTest, EveryColumnHasItsPathAndUnit) {
    LogLayout layout = makeLayout(1, Space::Tool, true);
    layout.limits = {LimitKind::Clearance, LimitKind::Speed};
    const Hdf5File file(exportRun(makeOpening(layout), makeRecords(layout, 20, 0.001, 62)));
    std::vector<std::string> paths;
    for (const auto& [name, unit] : listUnits()) {
        paths.push_back(name);
        EXPECT_EQ(file.hasAttribute(name, "words"), unit.empty()) << name;
        EXPECT_EQ(file.hasAttribute(name, "units"), !unit.empty()) << name;
        EXPECT_NE(file.readText(name, "meaning"), "") << name;
        if (!unit.empty()) EXPECT_EQ(file.readText(name, "units"), unit) << name;
    }
    EXPECT_EQ(file.listDatasets(), paths);
}

TEST_F(Hdf5ExportTest, JointsThatSlideHaveMetresAndNewtons) {
    LogOpening opening = makeOpening(makeLayout(2, Space::Joint, true));
    opening.layout.jointNames = {"lift", "turn"};
    opening.metadata["prismatic_joints"] = R"(["lift"])";
    const std::vector<TickRecord> records = makeRecords(opening.layout, 20, 0.001, 63);
    const Hdf5File file(exportRun(opening, records));
    const std::map<std::string, std::string> lift = {{"/nominal/lift/q_m", "m"},
                                                     {"/nominal/lift/qd_mps", "m/s"},
                                                     {"/nominal/lift/qdd_mps2", "m/s^2"},
                                                     {"/nominal/lift/jerk_mps3", "m/s^3"},
                                                     {"/filter/lift/tau_N", "N"},
                                                     {"/filter/lift/tau_removed_N", "N"},
                                                     {"/filter/lift/margin_m", "m"},
                                                     {"/filter/lift/stop_s", "s"},
                                                     {"/filter/lift/rest_m", "m"},
                                                     {"/limits/lift/position_lower_m", "m"},
                                                     {"/limits/lift/velocity_upper_mps", "m/s"},
                                                     {"/limits/lift/acceleration_upper_mps2", "m/s^2"},
                                                     {"/limits/lift/jerk_lower_mps3", "m/s^3"},
                                                     {"/command/lift/q_m", "m"},
                                                     {"/motor/lift/tau_N", "N"},
                                                     {"/nominal/turn/q_rad", "rad"},
                                                     {"/nominal/turn/jerk_radps3", "rad/s^3"},
                                                     {"/filter/turn/tau_Nm", "Nm"},
                                                     {"/nominal/tool/x_m", "m"}};
    for (const auto& [name, unit] : lift) EXPECT_EQ(file.readText(name, "units"), unit) << name;
    const std::vector<std::string> paths = file.listDatasets();
    for (const std::string& name : paths)
        if (name.find("/lift/") != name.npos) {
            EXPECT_EQ(name.find("rad"), name.npos) << name;
            EXPECT_EQ(name.find("Nm"), name.npos) << name;
        }
    const std::vector<double> q = file.readNumbers("/nominal/lift/q_m");
    ASSERT_EQ(q.size(), records.size());
    EXPECT_TRUE(areEqual(q[7], records[7].nominal.q[0]));

    exportCsv(path("run.mcap"), path("run.csv"));
    const std::string csv = readBytes(path("run.csv"));
    const std::string header = "," + csv.substr(0, csv.find('\n')) + ",";
    EXPECT_EQ(std::count(header.begin(), header.end(), ','), static_cast<long>(paths.size()) + 1);
    for (std::string name : paths) {
        name.erase(0, 1);
        std::replace(name.begin(), name.end(), '/', '.');
        EXPECT_NE(header.find("," + name + ","), header.npos) << name;
    }

    for (const char* wrong : {"lift", "[1]", "[\"nobody\"]", "{}"}) {
        opening.metadata["prismatic_joints"] = wrong;
        writeBytes(path("bad.mcap"), makeLog(opening, {}).bytes);
        const auto check = [&](const auto& call) {
            EXPECT_EQ(catchError(ErrorKind::BadInput, call),
                      path("bad.mcap").string() +
                          ": its metadata `prismatic_joints` are no JSON list of joints of this "
                          "log: " +
                          wrong + ". The log was not written by viable");
        };
        check([&] { exportHdf5(path("bad.mcap"), path("bad.h5")); });
        check([&] { exportCsv(path("bad.mcap"), path("bad.csv")); });
    }
    EXPECT_EQ(listFolder(), (std::vector<std::string>{"bad.mcap", "run.csv", "run.h5", "run.mcap"}));
}

TEST_F(Hdf5ExportTest, TheOpeningBecomesAttributesOfTheRoot) {
    LogOpening opening = makeOpening(makeLayout(1, Space::Joint, false));
    const std::string longText(300'000, 'y');
    const std::string binary("\0\1\377\0", 4);
    opening.metadata = {{"seed", "7"}, {"library", "another"}, {"", "no key"}, {"a/b", "\xC3\xBC"}};
    opening.attachments = {{"experiment.yaml", "application/yaml", "schema: 1\n"},
                           {"experiment.yaml", "application/yaml", longText},
                           {"seed", "text/plain", ""},
                           {"nominal", "application/octet-stream", binary}};
    const Hdf5File file(exportRun(opening, {}));
    EXPECT_EQ(file.readText("/", "library"), LogReader(path("run.mcap")).library());
    EXPECT_EQ(file.readText("/", "library_2"), "another");
    EXPECT_EQ(file.readText("/", "seed"), "7");
    EXPECT_EQ(file.readText("/", "unnamed"), "no key");
    EXPECT_EQ(file.readText("/", "a/b"), "\xC3\xBC");
    EXPECT_EQ(file.readText("/", "experiment.yaml"), "schema: 1\n");
    EXPECT_EQ(file.readText("/", "experiment.yaml_2"), longText);
    EXPECT_EQ(file.readText("/", "seed_2"), "");
    EXPECT_EQ(file.readBytes("nominal"), binary);
}

// Obstacles that are placed by hand come with rows of the log; how old they are says each row, in every form to the same bit.
TEST_F(Hdf5ExportTest, WhatIsPlacedInARunAndItsAgeAreExported) {
    LogLayout layout = makeLayout(1, Space::Tool, true);
    layout.limits = {LimitKind::Clearance};
    std::vector<TickRecord> records = makeRecords(layout, 2500, 0.001, 64);
    WrittenLog log;
    LogWriter writer(std::make_unique<MemorySink>(log), makeOpening(layout));
    for (std::size_t k = 0; k < records.size(); ++k) {
        const bool isPlaced = k > 2000;
        records[k].reports[LimitKind::Clearance].age_s = records[k].time_s - (isPlaced ? 2.0 : 0.0);
        if (k == 2001) writer.attach({"placed_obstacles.1.json", "application/json", R"({"placed":[],"stamp_s":2.0})"});
        writer.append(records[k]);
    }
    writer.finish();
    writeBytes(path("run.mcap"), log.bytes);
    exportHdf5(path("run.mcap"), path("run.h5"));
    exportCsv(path("run.mcap"), path("run.csv"));
    const Hdf5File file(path("run.h5"));
    ASSERT_TRUE(file.hasAttribute("/", "placed_obstacles.1.json"));
    EXPECT_EQ(file.readText("/", "placed_obstacles.1.json"), R"({"placed":[],"stamp_s":2.0})");
    const std::vector<double> ages = file.readNumbers("/clearance/map_age_s");
    ASSERT_EQ(ages.size(), records.size());
    std::ifstream csv(path("run.csv"));
    std::string line;
    std::getline(csv, line);
    const auto column =
        std::count(line.begin(), line.begin() + static_cast<long>(line.find("clearance.map_age_s")), ',');
    for (std::size_t k = 0; k < records.size(); ++k) {
        ASSERT_TRUE(areEqual(ages[k], records[k].reports[LimitKind::Clearance].age_s)) << k;
        std::getline(csv, line);
        std::istringstream cells(line);
        for (long i = 0; i <= column; ++i) std::getline(cells, line, ',');
        ASSERT_TRUE(areEqual(std::stod(line), ages[k])) << k << ": " << line;
    }
}

TEST_F(Hdf5ExportTest, ALogWithoutRowsHasEveryColumnEmpty) {
    LogLayout layout = makeLayout(1, Space::Tool, true);
    layout.limits = {LimitKind::Clearance, LimitKind::Speed};
    const Hdf5File file(exportRun(makeOpening(layout), {}));
    EXPECT_EQ(file.listDatasets().size(), listUnits().size());
    EXPECT_TRUE(file.readNumbers("/time_s").empty());
    EXPECT_TRUE(file.readIntegers("/tick/missed").empty());
    EXPECT_TRUE(file.readWords("/tick/status").empty());
}

TEST_F(Hdf5ExportTest, ALogThatWasCutOffGivesItsRows) {
    const LogLayout layout = makeLayout(2, Space::Joint, false);
    const std::vector<TickRecord> records = makeRecords(layout, 400, 0.001, 64);
    const WrittenLog log = makeLog(makeOpening(layout), records);
    writeBytes(path("cut.mcap"), log.bytes.substr(0, log.writes[4] + 50));
    exportHdf5(path("cut.mcap"), path("cut.h5"));
    const Hdf5File file(path("cut.h5"));
    const std::vector<double> torque = file.readNumbers("/filter/joint1/tau_Nm");
    ASSERT_EQ(torque.size(), 300u);
    for (std::size_t i = 0; i < torque.size(); ++i) ASSERT_TRUE(areEqual(torque[i], records[i].filterTorque[1]));
}

TEST_F(Hdf5ExportTest, NothingIsOverwrittenAndNothingIsLeft) {
    const LogLayout layout = makeLayout(2, Space::Joint, false);
    const WrittenLog log = makeLog(makeOpening(layout), makeRecords(layout, 9000, 0.001, 65));
    writeBytes(path("run.mcap"), log.bytes);
    writeBytes(path("run.h5"), "mine");
    for (const char* target : {"run.h5", "run.mcap"})
        EXPECT_EQ(catchError(ErrorKind::BadInput, [&] { exportHdf5(path("run.mcap"), path(target)); }),
                  path(target).string() +
                      ": the file exists already and is never overwritten. Choose another name or move "
                      "the old file away");
    EXPECT_EQ(readBytes(path("run.h5")), "mine");
    EXPECT_EQ(readBytes(path("run.mcap")), log.bytes);

    std::string damaged = log.bytes;
    damaged[log.writes[80] + 200] = static_cast<char>(damaged[log.writes[80] + 200] ^ 4);
    writeBytes(path("bad.mcap"), damaged);
    writeBytes(path("empty.mcap"), "");
    const auto open = countOpen();
    for (const char* bad : {"bad.mcap", "empty.mcap", "absent.mcap"}) {
        const std::string text = catchError(ErrorKind::BadInput, [&] { exportHdf5(path(bad), path("bad.h5")); });
        EXPECT_EQ(text.rfind(path(bad).string() + ": ", 0), 0u) << text;
    }
    const std::filesystem::path absent = path("absent") / "run.h5";
    EXPECT_EQ(catchError(ErrorKind::LogNotWritten, [&] { exportHdf5(path("run.mcap"), absent); }),
              absent.string() +
                  ": the file cannot be written: No such file or directory. Choose a "
                  "folder that exists, may be written to and has room");
    EXPECT_EQ(countOpen(), open);
    EXPECT_EQ(listFolder(), (std::vector<std::string>{"bad.mcap", "empty.mcap", "run.h5", "run.mcap"}));
}

TEST_F(Hdf5ExportTest, Fault72_AFullDiskLeavesNothing) {
    const LogLayout layout = makeLayout(6, Space::Joint, true);
    writeBytes(path("run.mcap"), makeLog(makeOpening(layout), makeRecords(layout, 4500, 0.001, 66)).bytes);
    exportHdf5(path("run.mcap"), path("whole.h5"));
    const auto size = static_cast<rlim_t>(std::filesystem::file_size(path("whole.h5")));
    std::filesystem::remove(path("whole.h5"));
    const auto open = countOpen();
    H5E_auto2_t print = nullptr, printAfter = nullptr;
    void *data = nullptr, *dataAfter = nullptr;
    H5Eget_auto2(H5E_DEFAULT, &print, &data);
    for (const rlim_t room : {rlim_t{1}, rlim_t{2000}, size / 10, size / 2, size - 5000, size - 1}) {
        SCOPED_TRACE("room for " + std::to_string(room) + " bytes of " + std::to_string(size));
        std::string text;
        ::testing::internal::CaptureStderr();
        {
            const FullDisk disk(room);
            text = catchError(ErrorKind::LogNotWritten, [&] { exportHdf5(path("run.mcap"), path("full.h5")); });
        }
        EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
        EXPECT_EQ(text, path("full.h5").string() +
                            ": the file cannot be written: File too large. Choose a folder that "
                            "exists, may be written to and has room");
        EXPECT_EQ(listFolder(), std::vector<std::string>{"run.mcap"});
        EXPECT_EQ(countOpen(), open) << "something of the file is still open";
    }
    H5Eget_auto2(H5E_DEFAULT, &printAfter, &dataAfter);
    EXPECT_EQ(print, printAfter) << "the library's own error output was switched off for good";
    exportHdf5(path("run.mcap"), path("whole.h5"));  // afterwards it works again
    EXPECT_EQ(Hdf5File(path("whole.h5")).readNumbers("/time_s").size(), 4500u);
}

}  // namespace
}  // namespace viable::test
