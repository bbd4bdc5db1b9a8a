#include "core/Sha256.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

using viable::detail::Sha256;

namespace {

std::string hash(std::string_view bytes) {
    Sha256 all;
    all.add(bytes);
    return all.take();
}

// NIST's examples of FIPS 180, and its long one of a million letters.
TEST(Sha256, IsThatOfTheStandardsExamples) {
    EXPECT_EQ(hash(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
    EXPECT_EQ(hash("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    EXPECT_EQ(hash("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
              "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
    EXPECT_EQ(hash(std::string(1'000'000, 'a')), "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

// Bytes 0xbd around the lengths of one and two blocks, against sha256sum of coreutils.
TEST(Sha256, PadsEveryLength) {
    EXPECT_EQ(hash(std::string(1, '\xbd')), "68325720aabd7c82f30f554b313d0570c95accbb7dc4b5aae11204c08ffe732b");
    EXPECT_EQ(hash(std::string(55, '\xbd')), "c45d311d78e9f5ffd8f292be48338425a8d7c52e3e7d992c360225b699b1788d");
    EXPECT_EQ(hash(std::string(56, '\xbd')), "c177fd57307d9e91ccdd55f53676bba8dab03512c5f0900e47dd370c4a737837");
    EXPECT_EQ(hash(std::string(57, '\xbd')), "12272d2d7c47addb1dd2eb0c73fa4692e8da47d5ad08bd418f09ea851e11062e");
    EXPECT_EQ(hash(std::string(63, '\xbd')), "7e85c1fc876e14fb88771233335aa6f6545198491d27de215de4121a13b7395f");
    EXPECT_EQ(hash(std::string(64, '\xbd')), "47caa1085b324b16e9d2038695cc09c06bcbc8e4cc00d5180687c9a525d047d7");
    EXPECT_EQ(hash(std::string(65, '\xbd')), "1a68512db22e81f0b6870c8606f7dbe6ea1b491f63f196d58049b200cfb07cc8");
    EXPECT_EQ(hash(std::string(119, '\xbd')), "f256956b33c0bd871514bcdec40ebedcdf9d28640e39b5eba519ed67b432df37");
    EXPECT_EQ(hash(std::string(120, '\xbd')), "1d83c08897fbf2128faa8a9ff5c8793efc85fe3b3ad7caff909ac231842a7ded");
    EXPECT_EQ(hash(std::string(128, '\xbd')), "df8d4a0abf0c83c802c129b1b5d635b0510085691180d4616b819d5e0f8cb47b");
}

TEST(Sha256, IsTheSameInWhateverPiecesTheBytesCome) {
    std::mt19937 random(1);
    std::string bytes(5000, '\0');
    for (char& byte : bytes) byte = static_cast<char>(random());
    for (int repetition = 0; repetition < 100; ++repetition) {
        Sha256 pieces;
        for (std::size_t at = 0; at < bytes.size();) {
            const std::size_t size = std::min<std::size_t>(random() % 200, bytes.size() - at);
            pieces.add(std::string_view(bytes).substr(at, size));
            at += size;
        }
        EXPECT_EQ(pieces.take(), hash(bytes));
    }
}

}  // namespace
