// A setting is one line: reader, schema, tables, and in Python keyword, check, docstring, signature and stub come from it.
#include <pybind11/embed.h>

#include "../../tools/python/src/Keywords.h"
#include "ExpectContains.h"
#include "config/ParameterJson.h"
#include "host/PluginDescription.h"

namespace viable::python {
namespace {

using test::expectContains;

struct Grip {
    double force_N = 40.0;

    template <class V>
    void describe(V& v) {
        v(force_N, "force_N", "N", "How hard the gripper closes.").above(0).upTo(140);
    }
};

/** All that a class of Python adds. */
class Gripper {
public:
    explicit Gripper(const py::kwargs& given) { describe(grip_).read("Gripper", given, 1); }
    static Keywords describe(Grip& grip) {
        Keywords keywords;
        grip.describe(keywords);
        return keywords;
    }
    double force() const { return grip_.force_N; }

private:
    Grip grip_;
};

PYBIND11_EMBEDDED_MODULE(hand, module) {
    Grip standard;
    defineClass<Gripper>(module, "Gripper", "Closes.\n\nKEYWORDS", Gripper::describe(standard), "")
        .def_property_readonly("force", &Gripper::force);
}

struct OneLine : ::testing::Test {
    static std::string run(const std::string& expression) {
        return py::str(py::eval(expression, py::module_::import("hand").attr("__dict__")));
    }
    static std::string refuse(const std::string& expression) {
        try {
            return "not refused: " + run(expression);
        } catch (const py::error_already_set& error) {
            return py::str(error.value());
        }
    }
    const py::scoped_interpreter interpreter_;
};

TEST_F(OneLine, IsReadAndTheSchemaAndTheTablesHaveIt) {
    Grip grip;
    readSettings(parseConfig("force_N: 60", "f.yaml"), grip);
    EXPECT_EQ(grip.force_N, 60.0);
    const ParameterSpec& row = settingsOf<Grip>().front();
    EXPECT_EQ(detail::makeSchema(row)["maximum"], 140);
    EXPECT_EQ(describeParameters(&row, 1),
              "  force_N [N]: number in (0, 140]; default 40\n      How hard the gripper closes.\n");
    expectContains(describeParametersAsMarkdown(&row, 1),
                   {"| `force_N` | N | number in (0, 140] | `40` | How hard the gripper closes. |"});

    EXPECT_EQ(run("Gripper(force=60).force"), "60.0");
    EXPECT_EQ(run("Gripper().force"), "40.0");
    EXPECT_EQ(run("[x for x in (1 / 3, 2**0.5, 139.99999999999997, 1e-300, 7) if Gripper(force=x).force != x]"), "[]");
    EXPECT_EQ(run("Gripper.__doc__"),
              "Closes.\n\n  force [N]: number in (0, 140]; default 40\n      How hard the gripper closes.\n");
    EXPECT_EQ(run("Gripper.__init__.__doc__"), "__init__(self, *, force: float = 40) -> None");
    EXPECT_EQ(run("__import__('inspect').signature(Gripper)"), "(*, force: 'float' = 40) -> 'None'");
    EXPECT_EQ(refuse("Gripper(force=200)"),
              "Gripper: force: 200 is out of range; allowed is (0, 140]. Choose a value inside the range");
    expectContains(refuse("Gripper(forse=1)"), {"Gripper: forse: ", "Did you mean `force`?"});
}

}  // namespace
}  // namespace viable::python
