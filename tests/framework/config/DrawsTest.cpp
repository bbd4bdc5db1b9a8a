#include "config/Draws.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <functional>
#include <numeric>

#include "Complaint.h"

namespace viable {
namespace {

ConfigNode parse(const std::string& text) {
    return parseConfig(text, "e.yaml");
}

/** The values of the key `x` in `count` runs. */
std::vector<double> draw(const std::string& distribution, int count, std::uint64_t seed = 1,
                         const std::string& others = "") {
    const ConfigNode root = parse("x: " + distribution + "\n" + others);
    std::vector<double> values;
    for (int run = 0; run < count; ++run) {
        ConfigNode drawn = root;
        resolveDraws(drawn, {seed, run});
        values.push_back(toNumber(*drawn.find("x")));
    }
    return values;
}

/** Kolmogorov-Smirnov: the largest distance of the drawn share below x from the law's. */
double calcDistance(std::vector<double> values, const std::function<double(double)>& law) {
    std::sort(values.begin(), values.end());
    double worst = 0.0;
    const double n = static_cast<double>(values.size());
    for (std::size_t i = 0; i < values.size(); ++i) {
        const double p = law(values[i]);
        worst =
            std::max({worst, std::abs(p - static_cast<double>(i) / n), std::abs(p - static_cast<double>(i + 1) / n)});
    }
    return worst;
}

constexpr int kDraws = 4000;
/** Exceeded by chance in one of 1000 samples; the seeds are fixed. */
const double kBound = 1.95 / std::sqrt(static_cast<double>(kDraws));

double calcNormal(double z) {
    return 0.5 * std::erfc(-z / std::sqrt(2.0));
}

double calcCorrelation(const std::vector<double>& a, const std::vector<double>& b) {
    const auto n = static_cast<double>(a.size());
    const double ma = std::accumulate(a.begin(), a.end(), 0.0) / n;
    const double mb = std::accumulate(b.begin(), b.end(), 0.0) / n;
    double ab = 0.0, aa = 0.0, bb = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        ab += (a[i] - ma) * (b[i] - mb);
        aa += (a[i] - ma) * (a[i] - ma);
        bb += (b[i] - mb) * (b[i] - mb);
    }
    return ab / std::sqrt(aa * bb);
}

void expectSays(const std::string& text, const std::vector<std::string>& parts) {
    const std::string complaint = test::findComplaint([&] { listDraws(parse(text)); });
    for (const std::string& part : parts) EXPECT_CONTAINS(complaint, part) << text;
}

TEST(Draws, FollowTheirDistributions) {
    EXPECT_LE(
        calcDistance(draw("~uniform(-pi/2, 3*(1+1))", kDraws), [&](double x) { return (x + kPi / 2) / (6 + kPi / 2); }),
        kBound);
    EXPECT_LE(calcDistance(draw("~log_uniform(0.01, 100)", kDraws), [](double x) { return (std::log10(x) + 2) / 4; }),
              kBound);
    EXPECT_LE(calcDistance(draw("~normal(3, 0.5)", kDraws), [](double x) { return calcNormal((x - 3) / 0.5); }),
              kBound);
    const double low = calcNormal(-1), high = calcNormal(2);
    EXPECT_LE(calcDistance(draw("~normal(3, 0.5, 2.5, 4)", kDraws),
                           [&](double x) { return (calcNormal((x - 3) / 0.5) - low) / (high - low); }),
              kBound);
}

TEST(Draws, KeepTheirRange) {
    for (const double x : draw("~uniform(2, 3)", kDraws)) EXPECT_TRUE(x >= 2 && x <= 3) << x;
    for (const double x : draw("~log_uniform(1e-300, 1e300)", kDraws)) EXPECT_TRUE(x >= 1e-300 && x <= 1e300) << x;
    for (const double x : draw("~normal(0, 1, 1.5, 1.6)", kDraws)) EXPECT_TRUE(x >= 1.5 && x <= 1.6) << x;
}

TEST(Draws, IntegersAndChoicesAreEquallyLikely) {
    std::vector<int> counts(7);
    for (const double x : draw("~integer(-3, 3)", kDraws)) ++counts.at(static_cast<std::size_t>(x + 3));
    double chi2 = 0.0;
    for (const int count : counts) chi2 += std::pow(count - kDraws / 7.0, 2) / (kDraws / 7.0);
    EXPECT_LE(chi2, 22.5);  // 6 degrees of freedom, 1 of 1000

    const ConfigNode root = parse("x: ~choice(robot, true, 2*pi, -1)\n");
    std::map<std::string, int> words;
    for (int run = 0; run < kDraws; ++run) {
        ConfigNode drawn = root;
        ++words[resolveDraws(drawn, {5, run}).at("x")];
        EXPECT_FALSE(drawn.find("x")->quoted);
    }
    ASSERT_EQ(words.size(), 4u);
    for (const char* word : {"robot", "true", "2*pi", "-1"})
        EXPECT_NEAR(words[word], kDraws / 4, 3.3 * std::sqrt(kDraws * 0.25 * 0.75)) << word;
}

TEST(Draws, ChoicesOfNumbersAreNumbersAndQuotesKeepCommas) {
    const auto keys =
        listDraws(parse("x: ~choice(15, pi*5, 9007199254740993)\n"
                        "y: ~choice(\"a, (b\", 'c', don't, 2*pi)\n"));
    EXPECT_EQ(keys[0].ends, (std::vector<std::string>{"15", "15.707963267948966", "9007199254740993"}));
    EXPECT_FALSE(keys[0].isOfWords);
    EXPECT_EQ(keys[1].ends, (std::vector<std::string>{"a, (b", "c", "don't", "2*pi"}));
    EXPECT_TRUE(keys[1].isOfWords);
}

// Ends of the whole range: 2^54 values, none of them lost.
TEST(Draws, WholeNumbersMayBeLarge) {
    for (const double x : draw("~integer(-9007199254740992, 9007199254740992)", 100)) EXPECT_EQ(x, std::floor(x));
    EXPECT_EQ(draw("~integer(7, 7)", 1).front(), 7.0);
}

TEST(Draws, AreIndependentOfEachOther) {
    const std::string two = "y: ~uniform(0, 1)\nz: {x: '~uniform(0, 1)'}\n";
    const std::vector<double> alone = draw("~uniform(0, 1)", kDraws);
    EXPECT_EQ(alone, draw("~uniform(0, 1)", kDraws, 1, two)) << "another key has shifted this one";
    std::vector<double> y, inner;
    for (int run = 0; run < kDraws; ++run) {
        ConfigNode drawn = parse("x: ~uniform(0, 1)\n" + two);
        resolveDraws(drawn, {1, run});
        y.push_back(toNumber(*drawn.find("y")));
        inner.push_back(toNumber(*drawn.find("z")->find("x")));
    }
    const double bound = 3.3 / std::sqrt(static_cast<double>(kDraws));
    EXPECT_LE(std::abs(calcCorrelation(alone, y)), bound);
    EXPECT_LE(std::abs(calcCorrelation(alone, inner)), bound);
    EXPECT_LE(std::abs(calcCorrelation(alone, draw("~uniform(0, 1)", kDraws, 2))), bound);
    const std::vector<double> next(alone.begin() + 1, alone.end());
    EXPECT_LE(std::abs(calcCorrelation({alone.begin(), alone.end() - 1}, next)), bound);
}

TEST(Draws, AreTheShortestTextOfTheirNumber) {
    ConfigNode drawn = parse("x: [~choice(1)]\ny: ~uniform(0, 1)\n");
    const auto values = resolveDraws(drawn, {3, 4});
    EXPECT_EQ(values.at("x[0]"), "1");
    EXPECT_EQ(values.at("y"), drawn.find("y")->text);
    char shortest[32];
    const auto end = std::to_chars(shortest, shortest + sizeof shortest, std::stod(values.at("y")));
    EXPECT_EQ(std::string(shortest, end.ptr), values.at("y"));
    EXPECT_TRUE(listDraws(drawn).empty());
}

TEST(Draws, AreListedWithTheirEnds) {
    const auto keys =
        listDraws(parse("a: ~uniform(0, pi)\nb: [1, '~normal(0, 1)']\n"
                        "c: {d: '~normal(0, 1, -2, 2)', e: '~choice(x, y)'}\n"
                        "f: ~integer(1, 9)\ng: ~/file\nh: ~\ni: ~someone/uniform(1)\n"));
    ASSERT_EQ(keys.size(), 5u);
    EXPECT_EQ(keys[0].keyPath, "a");
    EXPECT_EQ(keys[0].distribution, "uniform(0, pi)");
    EXPECT_EQ(keys[0].place, "e.yaml:1:4: a");
    EXPECT_EQ(keys[0].ends, (std::vector<std::string>{"0", "3.141592653589793"}));
    EXPECT_EQ(keys[1].keyPath, "b[1]");
    EXPECT_TRUE(keys[1].ends.empty());
    EXPECT_EQ(keys[2].ends, (std::vector<std::string>{"-2", "2"}));
    EXPECT_EQ(keys[3].ends, (std::vector<std::string>{"x", "y"}));
    EXPECT_EQ(keys[4].ends, (std::vector<std::string>{"1", "9"}));
    ConfigNode drawn = parse("a: ~uniform(0, pi)\n");
    EXPECT_EQ(resolveDraws(drawn, {1, 0}, {{"a", "3"}}).at("a"), "3");
}

TEST(Draws, BadTextsAreToldWithPlaceAndRemedy) {
    expectSays("x: ~unifrom(0, 1)\n", {"e.yaml:1:4: x", "`~unifrom`", "Did you mean `~uniform`?"});
    expectSays("x: ~uniform\n", {"has no parentheses", "~uniform(a, b)"});
    expectSays("x: ~uniform(0, 1\n", {"no closing parenthesis"});
    expectSays("x: ~uniform(1)\n", {"has 1 number"});
    expectSays("x: ~uniform(0, 1, 2)\n", {"has 3 numbers"});
    expectSays("x: ~uniform(1, 0)\n", {"not below", "smaller number first"});
    expectSays("x: ~uniform(0, )\n", {"empty place"});
    expectSays("x: ~uniform(0, one)\n", {"`one` is not a number"});
    expectSays("x: ~uniform(0, .inf)\n", {"must be finite"});
    expectSays("x: ~uniform(0, 1) * 2\n", {"more behind the draw"});
    expectSays("x: ~log_uniform(0, 1)\n", {"no logarithm"});
    expectSays("x: ~normal(0, 0)\n", {"standard deviation"});
    expectSays("x: ~normal(0, 1, 2, 1)\n", {"cut", "empty"});
    expectSays("x: ~normal(0, 1, 5, 6)\n", {"less than a thousandth"});
    expectSays("x: ~normal(0, 1, -6, -5)\n", {"less than a thousandth"});
    expectSays("x: ~integer(0.5, 1)\n", {"whole number"});
    expectSays("x: ~integer(2, 1)\n", {"above the second"});
    expectSays("robot: ~choice(a, b)\n", {"same in every run"});
    expectSays("cases: {A: {robot: '~choice(a, b)'}}\n", {"cases.A.robot", "same in every run"});
}

TEST(Draws, WithoutQuotesBetweenBracketsTheErrorSaysSo) {
    const char* const remedy = "needs quotes because of its commas, such as '~uniform(1, 2)'";
    expectSays("a:\n  - {x: ~uniform(0, 1)}\n", {"e.yaml:2", "a[0].x", "`~uniform(0`", remedy});
    expectSays("x: [~uniform(0, 1), 2]\n", {"e.yaml:1:5: x[0]", remedy});
    ConfigNode root = parse("x: 1\n");
    test::expectError({remedy}, [&] { applyOverride(root, "x={a: ~uniform(0, 1)}"); });
}

TEST(Draws, IndexOfARun) {
    const DrawIndex index = parseDrawIndex("18446744073709551615:9", "--draw");
    EXPECT_EQ(index.seed, 18446744073709551615u);
    EXPECT_EQ(index.run, 9);
    for (const char* text : {"", "1", "1:", ":1", "1:-2", "1:2x", "-1:2", "1:2:3"})
        EXPECT_THROW(parseDrawIndex(text, "--draw"), Error) << text;
}

}  // namespace
}  // namespace viable
