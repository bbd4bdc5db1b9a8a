#include <cmath>

#include "ConfigTestSupport.h"

namespace viable {
namespace {

/** The value of `v` in a file with that one entry. */
ConfigNode makeValue(const std::string& text) {
    return *parseConfig("v: " + text + "\n", "f").find("v");
}
double readNumber(const std::string& text, const NumberRange& range = {}) {
    return toNumber(makeValue(text), range);
}
std::string refuseNumber(const std::string& text, const NumberRange& range = {}) {
    return catchError([&] { readNumber(text, range); });
}

TEST(ConfigValues, ABlankIsToldAsNotFilledIn) {
    expectContains(refuseNumber("TODO"), {"f:1:4: v: not filled in yet", "Write the value in place of TODO"});
    expectError({"f:1:4: v: not filled in yet"}, [] { toJointVector(makeValue("TODO"), 3); });
    expectError({"f:1:8: v[1]: not filled in yet"}, [] { toJointVector(makeValue("[1, TODO, 3]"), 3); });
    expectContains(refuseNumber("todo"), {"`todo` is not a number"});
    expectContains(refuseNumber("\"TODO\""), {"in quotes is text"});
    EXPECT_NO_THROW(refuseBlank(makeValue("\"TODO\"")));
    EXPECT_THROW(refuseBlank(makeValue("TODO")), Error);
}

TEST(ConfigValues, NumbersAndExpressions) {
    const std::vector<std::pair<const char*, double>> table = {
        {"3", 3.0},          {"-3", -3.0},
        {"+3", 3.0},         {"0", 0.0},
        {"0.5", 0.5},        {".5", 0.5},
        {"5.", 5.0},         {"0e5", 0.0},
        {"1e3", 1000.0},     {"1E-3", 1e-3},
        {"1.25e+2", 125.0},  {"0.1", 0.1},
        {"1e300", 1e300},    {"2.5e-308", 2.5e-308},
        {"-pi", -kPi},       {"2*pi/3", 2 * kPi / 3},
        {"4*pi", 4 * kPi},   {"-5*pi/12", -5 * kPi / 12},
        {"1 + 2 * 3", 7.0},  {"(1+2)*3", 9.0},
        {"8/4/2", 1.0},      {"8-4-2", 2.0},
        {"8 - 4 -  2", 2.0}, {"8- 4", 4.0},
        {"2--3", 5.0},       {"-(2-3)", 1.0},
        {"2*-3", -6.0},      {"90*pi/180", 90 * kPi / 180},
        {"pi-pi", 0.0},      {"0*5", 0.0},
        {"0/5", 0.0},        {"((((1))))", 1.0},
        {"pi", kPi},
    };
    for (const auto& [text, value] : table) {
        SCOPED_TRACE(text);
        EXPECT_EQ(readNumber(text), value);
    }
    EXPECT_EQ(makeValue("2*pi/3").text, "2*pi/3");
}

TEST(ConfigValues, ExpressionsThatAreNone) {
    const std::vector<std::pair<const char*, std::vector<std::string>>> table = {
        {"abc", {"f:1:4: v", "`abc` is not a number", "`2*pi/3`"}},
        {"2*", {"ends too early"}},
        {"(1+2", {"a `)` is missing"}},
        {"1+2)", {"`)` is not expected"}},
        {"2**3", {"`*3` is not expected"}},
        {"2^3", {"`^3` is not expected"}},
        {"1,5", {"decimal point"}},
        {"1.2.3", {"`.3` is not expected"}},
        {".", {"is not expected"}},
        {"()", {"is not expected"}},
        {"2pi", {"`pi` follows a value", "`2*pi`"}},
        {"pie", {"`pie` is not a number"}},
        {"sin(1)", {"`sin` is neither a number nor pi"}},
        {"1e", {"`e` follows the number"}},
        {"1/0", {"divides by zero"}},
        {"1/(pi-pi)", {"divides by zero"}},
        {"0x10", {"only decimal numbers"}},
        {"0b1", {"only decimal numbers"}},
        {"1_000", {"`_` may not stand between digits"}},
        {"true", {"`true` is not a number"}},
        {"[1]", {"must be a number; it is a list of 1"}},
        {"{a: 1}", {"must be a number; it is a map"}},
        {"~", {"must be a number; it is empty"}},
        {"\"3\"", {"`3` in quotes is text", "Remove the quotes"}},
        {"'3'", {"`3` in quotes is text"}},
        {"1 2", {"`2` is not expected"}},
        {"1 -2", {"`-2` follows a value without a comma", "Put a comma"}},
        {"pi +2", {"`+2` follows a value without a comma"}},
    };
    for (const auto& [text, message] : table) {
        SCOPED_TRACE(text);
        expectContains(refuseNumber(text), message);
    }
    expectContains(refuseNumber(repeat("(", 100) + "1" + repeat(")", 100)), {"more than 32 signs and parentheses"});
    expectContains(refuseNumber(repeat("-", 100) + "1"), {"more than 32 signs"});
    expectContains(refuseNumber(std::string(100000, '1')), {"longer than 256 bytes", "..."});
}

TEST(ConfigValues, Fault04_NotFiniteUnderflowOverflowAndLeadingZeros) {
    for (const char* text : {".nan", ".NaN", "nan", "-nan", "NAN"}) {
        SCOPED_TRACE(text);
        expectContains(refuseNumber(text), {"f:1:4: v", text, "is not a number"});
        NumberRange range;
        range.mayBeInfinite = true;
        expectContains(refuseNumber(text, range), {"is not a number"});
    }
    for (const char* text : {".inf", "-.inf", "+.inf", ".INF", "inf", "-Infinity"}) {
        SCOPED_TRACE(text);
        expectContains(refuseNumber(text), {"f:1:4: v", text, "must be finite"});
    }
    for (const char* text : {"1e-400", "-1e-400", "0.001e-400", "123456e-999999999", "1e-310", "5e-324",
                             "1e-200*1e-200", "1e-200/1e200", "1e-300/1e300"}) {
        SCOPED_TRACE(text);
        expectContains(refuseNumber(text), {"too small for a double"});
    }
    for (const char* text :
         {"1e400", "-1e400", "0.1e400", "1e999999999", "1e200*1e200", "1e200/1e-200", "1.7e308+1.7e308"}) {
        SCOPED_TRACE(text);
        expectContains(refuseNumber(text), {"too large for a double"});
    }
    EXPECT_EQ(readNumber("0e-400"), 0.0);
    EXPECT_EQ(readNumber("0.0e400"), 0.0);
    for (const char* text : {"010", "-010", "00", "01.5", "007", "2*010", "00e1"}) {
        SCOPED_TRACE(text);
        expectContains(refuseNumber(text), {"begins with a zero", "without leading zeros"});
    }
    expectError({"f:1:4: v", "`010` is not a whole number in [0, 100]", "leading zeros"},
                [] { toInteger(makeValue("010"), 0, 100); });
}

TEST(ConfigValues, Fault04_InfinityOnlyWhereItMeansNoLimit) {
    NumberRange range;
    range.min = 0.0;
    range.minIsOpen = true;
    range.max = 10.0;
    EXPECT_EQ(range.text(), "(0, 10]");
    expectContains(refuseNumber(".inf", range), {"must be finite"});
    range.mayBeInfinite = true;
    EXPECT_EQ(range.text(), "(0, 10] or .inf");
    EXPECT_EQ(readNumber(".inf", range), kInfinity);
    EXPECT_EQ(readNumber("+.Inf", range), kInfinity);
    expectContains(refuseNumber("-.inf", range), {"out of range", "(0, 10] or .inf"});
    expectContains(refuseNumber("inf", range), {"Write `.inf` or `-.inf`"});
    expectContains(refuseNumber("11", range), {"11 is out of range"});
    const NumberRange lower{-kInfinity, 0.0, false, true, true};
    EXPECT_EQ(readNumber("-.inf", lower), -kInfinity);
    expectContains(refuseNumber(".inf", lower), {"(-inf, 0) or -.inf"});
    EXPECT_EQ((NumberRange{-kInfinity, kInfinity, false, false, true}).text(), "(-inf, inf), .inf or -.inf");
}

TEST(ConfigValues, RangesNameValueAndBounds) {
    const NumberRange range{0.0, 2.0, false, true, false};
    EXPECT_EQ(range.text(), "[0, 2)");
    EXPECT_TRUE(range.contains(0.0));
    EXPECT_FALSE(range.contains(2.0));
    EXPECT_FALSE(range.contains(std::nan("")));
    EXPECT_FALSE(range.contains(kInfinity));
    EXPECT_EQ(readNumber("0", range), 0.0);
    expectContains(refuseNumber("2", range),
                   {"f:1:4: v: 2 is out of range; allowed is [0, 2)", "Choose a value inside"});
    expectContains(refuseNumber("-1e-3", range), {"`-1e-3` = -0.001 is out of range"});
    expectContains(refuseNumber("pi", range), {"`pi` = 3.141592653589793 is out of range"});
    EXPECT_EQ(NumberRange{}.text(), "(-inf, inf)");
}

TEST(ConfigValues, Integers) {
    EXPECT_EQ(toInteger(makeValue("42"), 0, 100), 42);
    EXPECT_EQ(toInteger(makeValue("-42"), -100, 100), -42);
    EXPECT_EQ(toInteger(makeValue("9223372036854775807"), 0, INT64_MAX), INT64_MAX);
    EXPECT_EQ(toInteger(makeValue("-9223372036854775808"), INT64_MIN, 0), INT64_MIN);
    for (const char* text : {"3.0", "1e3", "pi", "+3", "0x10", "1_000", "3 s", "--3", "-a", "2*3"}) {
        SCOPED_TRACE(text);
        expectError({"f:1:4: v", text, "a whole number in [0, 100]", "digits only"},
                    [&] { toInteger(makeValue(text), 0, 100); });
    }
    for (const char* text : {"101", "-1", "9223372036854775808", "99999999999999999999999"}) {
        SCOPED_TRACE(text);
        expectError({"f:1:4: v", text, "out of range", "[0, 100]"}, [&] { toInteger(makeValue(text), 0, 100); });
    }
    expectError({"Remove the quotes"}, [] { toInteger(makeValue("'3'"), 0, 9); });
    expectError({"a list of 1"}, [] { toInteger(makeValue("[3]"), 0, 9); });
}

TEST(ConfigValues, FlagsTextsAndChoices) {
    EXPECT_TRUE(toFlag(makeValue("true")));
    EXPECT_FALSE(toFlag(makeValue("false")));
    for (const char* text : {"yes", "no", "on", "True", "FALSE", "1", "0", "'true'", "[]"}) {
        SCOPED_TRACE(text);
        expectError({"f:1:4: v", "must be `true` or `false`"}, [&] { toFlag(makeValue(text)); });
    }
    EXPECT_EQ(toText(makeValue("010")), "010");
    EXPECT_EQ(toText(makeValue("''")), "");
    expectError({"must be text", "a map"}, [] { toText(makeValue("{}")); });
    const std::vector<std::string> choices = {"rectangular", "triangular"};
    EXPECT_EQ(toChoice(makeValue("triangular"), choices), "triangular");
    expectError({"f:1:4: v", "`triangulr`", "Did you mean `triangular`?", "Choices: `rectangular`, `triangular`"},
                [&] { toChoice(makeValue("triangulr"), choices); });
    const std::string far = catchError([&] { toChoice(makeValue("x"), choices); });
    EXPECT_EQ(far.find("Did you mean"), std::string::npos) << far;
}

TEST(ConfigValues, Fault05_WrongSizeAndScalarForList) {
    EXPECT_EQ(toNumbers(makeValue("[1, pi, -2]"), 3, 3), (std::vector<double>{1, kPi, -2}));
    EXPECT_EQ(toNumbers(makeValue("[]"), 0, 3), std::vector<double>{});
    expectError({"f:1:4: v", "must be a list of 3 numbers; it is a list of 2"},
                [] { toNumbers(makeValue("[1, 2]"), 3, 3); });
    expectError({"1 to 2 numbers", "a list of 3"}, [] { toNumbers(makeValue("[1, 2, 3]"), 1, 2); });
    expectError({"must be a list of 3 numbers; it is the single value `3`", "brackets"},
                [] { toNumbers(makeValue("3"), 3, 3); });
    expectError({"f:1:8: v[1]", "must be a number; it is a list of 1"},
                [] { toNumbers(makeValue("[1, [2], 3]"), 3, 3); });
    expectError({"v[1]", "it is empty"}, [] { toNumbers(makeValue("[1,, 3]"), 3, 3); });

    EXPECT_EQ(toJointVector(makeValue("2*pi"), 7), JointVector::Constant(7, 2 * kPi));
    const JointVector values = toJointVector(makeValue("[1, 2, 3]"), 3);
    ASSERT_EQ(values.size(), 3);
    EXPECT_EQ(values[2], 3.0);
    for (const char* text : {"[1, 2]", "[1, 2, 3, 4]", "[]", "[1]"}) {
        SCOPED_TRACE(text);
        expectError({"f:1:4: v", "list of 3 numbers, one per joint", "it is a list of "},
                    [&] { toJointVector(makeValue(text), 3); });
    }
    expectError({"a map"}, [] { toJointVector(makeValue("{a: 1}"), 3); });
    expectError({"f:1:8: v[1]: -2 is out of range; allowed is [0, 9]"}, [] {
        toJointVector(makeValue("[1, -2, 3]"), 3, {0.0, 9.0});
    });
}

TEST(ConfigValues, Fault05_UnitInTheValue) {
    for (const char* text : {"3 rad", "3rad", "2*pi rad/s", "(1+2) Nm", "pi rad", "0.5m"}) {
        SCOPED_TRACE(text);
        expectContains(refuseNumber(text), {"follows the number", "Write the number alone: the unit is in the key"});
    }
    for (const char* text : {"90 deg", "90deg", "90 degrees", "90\xC2\xB0"}) {
        SCOPED_TRACE(text);
        expectContains(refuseNumber(text), {"the unit is in the key", "`90*pi/180`"});
    }
}

}  // namespace
}  // namespace viable
