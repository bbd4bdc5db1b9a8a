#pragma once

#include <cstdint>
#include <vector>

namespace viable::detail {

/** Many quantities over time, thinned out while they are added: least and largest value of each bucket of equally many
rows. When there are too many buckets, neighbours are joined, so that any number of rows fits and no peak is lost. */
class Tracks {
public:
    /** @param most  buckets, even */
    Tracks(std::size_t quantities, std::size_t most) : most_(most), least_(quantities), largest_(quantities) {}

    /** One row; values[quantity]. What is not a number leaves a gap only where nothing else falls into its bucket. */
    void add(const std::vector<double>& values);

    std::size_t buckets() const { return least_.empty() ? 0 : least_.front().size(); }
    std::int64_t rowsPerBucket() const { return rowsPerBucket_; }
    const std::vector<float>& least(std::size_t quantity) const { return least_[quantity]; }
    const std::vector<float>& largest(std::size_t quantity) const { return largest_[quantity]; }

private:
    std::size_t most_;
    std::vector<std::vector<float>> least_, largest_;
    std::int64_t rowsPerBucket_ = 1, rowsInLast_ = 0;
};

/** One small number per row, such as a status: per bucket the largest, or of sets of bits the union. Thinned out like
Tracks. */
class CodeTracks {
public:
    enum class Join { Largest, Union };
    CodeTracks(std::size_t quantities, Join join, std::size_t most) : most_(most), codes_(quantities), join_(join) {}
    void add(const std::vector<std::uint16_t>& values);
    const std::vector<std::uint16_t>& codes(std::size_t quantity) const { return codes_[quantity]; }

private:
    std::size_t most_;
    std::vector<std::vector<std::uint16_t>> codes_;
    Join join_;
    std::int64_t rowsPerBucket_ = 1, rowsInLast_ = 0;
};

/** Samples at equal distances, at most kMaxSamples: of too many, every second is dropped. */
class Samples {
public:
    static constexpr std::size_t kMaxSamples = 4000;  ///< even

    /** Which of the rows between two samples one is: the first, or that whose first number is largest. */
    enum class Keep { First, Largest };
    explicit Samples(std::size_t width, Keep keep = Keep::First) : width_(width), keep_(keep) {}
    void add(const std::vector<double>& values);
    std::size_t count() const { return data_.size() / (width_ > 0 ? width_ : 1); }
    std::int64_t rowsPerSample() const { return stride_; }
    const std::vector<float>& data() const { return data_; }

private:
    std::size_t width_;
    Keep keep_;
    std::int64_t stride_ = 1, row_ = 0;
    std::vector<float> data_;
};

}  // namespace viable::detail
