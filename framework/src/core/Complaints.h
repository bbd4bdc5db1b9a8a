#pragma once

#include <string>
#include <vector>

namespace viable::detail {

/** What is wrong with one file or request, told together: who mends it wants all of it at once. */
class Complaints {
public:
    /** The arguments of badInput(). */
    void add(const std::string& where, const std::string& what, const std::string& remedy = {});
    bool isEmpty() const { return all_.empty(); }
    std::size_t size() const { return all_.size(); }

    /** Throws Error (BadInput) unless empty: one complaint as badInput() tells it, several as a numbered list.
    @param subject  what all of them are about, such as a file */
    void throwIfAny(const std::string& subject) const;

private:
    struct Complaint {
        std::string where, what, remedy;
    };
    std::vector<Complaint> all_;
};

}  // namespace viable::detail
