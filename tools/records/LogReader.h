#pragma once

#include "log/LogFields.h"

namespace viable {

/** One column of a log seen as a table: "time_s", "nominal.joint0.q_rad", "tick.status", ... */
class LogColumn {
public:
    LogColumn(std::string name, const LogField& field, int index)
        : name_(std::move(name)), field_(&field), index_(index) {}

    const std::string& name() const { return name_; }
    bool isText() const { return field_->isText(); }                     ///< a word; otherwise a number
    bool isInteger() const { return field_->kind == LogKind::Integer; }  ///< a number without fraction
    bool mayLack() const { return field_->mayLack; }                     ///< LogField::mayLack
    /** The value of a column that is no text. */
    double getNumber(const TickRecord& record) const {
        return isInteger() ? static_cast<double>(field_->integer(record)) : field_->getNumber(record, index_);
    }
    std::int64_t getInteger(const TickRecord& record) const { return field_->integer(record); }
    /** The value of a text column. */
    const char* getText(const TickRecord& record) const { return field_->text(record, index_); }

private:
    std::string name_;
    const LogField* field_;
    int index_;  // joint or element
};

/** The columns of a log as this version writes it, in the order of the CSV export. */
std::vector<LogColumn> listColumns(const LogLayout& layout);

/** Reads a log, finished or cut off: a file without its end gives every whole chunk that it has.
Checksums are checked; no length in the file is trusted before it is checked. Fields are found by
their names in the file's own schemas: what an older log lacks keeps the default of TickRecord
(vectors: empty), what a newer one has in addition is skipped.

Every failure is an Error (BadInput) with the file, the byte offset and the reason. */
class LogReader {
public:
    /** Opens the file and reads it up to its first row. */
    explicit LogReader(const std::filesystem::path& file);
    ~LogReader();

    const LogLayout& layout() const;
    const std::string& library() const;  ///< what wrote it, such as "viable 0.1.0"
    const std::map<std::string, std::string>& metadata() const;
    /** Those up to the row that was read last. */
    const std::vector<LogAttachment>& attachments() const;
    const std::vector<LogColumn>& columns() const;  ///< those that the file has
    /** Does the file have its end? Known from the beginning. */
    bool isComplete() const;

    /** The next row; false at the end of the file, or of what is left of it, or of the take that was asked for. Throws Error
    (BadInput) where there is no such take. */
    bool read(TickRecord& record);
    /** Before the first read(): only the rows of that take of an operator (TickRecord::take), from the later files of the log
    (LogSeries), too; their attachments are left out. 0: all rows of this file. */
    void keepTake(std::int64_t take);

private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace viable
