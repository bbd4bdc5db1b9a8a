
#include <algorithm>
#include <set>

#include "core/WholeFile.h"
#include "records/ColumnMeaning.h"
#include "records/Hdf5ExportDriver.h"
#include "records/LogExport.h"
#include "records/LogExportColumns.h"

namespace viable {

namespace {

constexpr hsize_t kBlockRows = 4096;
constexpr unsigned kDeflateLevel = 4;

/** Keeps the library from printing its errors, which are ours to report. */
class QuietLibrary {
public:
    QuietLibrary() {
        H5Eget_auto2(H5E_DEFAULT, &print_, &data_);
        H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    }
    ~QuietLibrary() { H5Eset_auto2(H5E_DEFAULT, print_, data_); }
    QuietLibrary(const QuietLibrary&) = delete;
    QuietLibrary& operator=(const QuietLibrary&) = delete;

private:
    H5E_auto2_t print_ = nullptr;
    void* data_ = nullptr;
};

/** What the library's innermost function said when it failed. */
std::string findReason() {
    std::string reason;
    const auto take = [](unsigned, const H5E_error2_t* error, void* to) -> herr_t {
        if (error->desc) *static_cast<std::string*>(to) = error->desc;
        return 1;  // the first is the innermost
    };
    H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, take, &reason);
    return reason.empty() ? "unknown error of the HDF5 library" : reason;
}

/** The library's answer, or an Error: what can fail here is writing. */
template <class Id>
Id require(Id id, const detail::WholeFile& file) {
    if (id < 0) throw file.notWritten(findReason());
    return id;
}

/** An HDF5 identifier that is closed at the end. */
class Handle {
public:
    Handle(hid_t id, herr_t (*release)(hid_t)) : id_(id), close_(release) {}
    ~Handle() {
        if (id_ >= 0) close_(id_);
    }
    Handle(const Handle&) = delete;
    Handle& operator=(const Handle&) = delete;
    hid_t id() const { return id_; }
    /** Closes now; negative when that failed. */
    herr_t close() {
        const hid_t id = id_;
        id_ = -1;
        return close_(id);
    }

private:
    hid_t id_;
    herr_t (*close_)(hid_t);
};

/** An attribute of any length: its values lie outside of the object's header. */
void setAttribute(hid_t object, const std::string& name, hid_t type, hid_t space, const void* values,
                  const detail::WholeFile& file) {
    const Handle creation(require(H5Pcreate(H5P_ATTRIBUTE_CREATE), file), H5Pclose);
    require(H5Pset_char_encoding(creation.id(), H5T_CSET_UTF8), file);
    const Handle attribute(require(H5Acreate2(object, name.c_str(), type, space, creation.id(), H5P_DEFAULT), file),
                           H5Aclose);
    require(H5Awrite(attribute.id(), type, values), file);
}

/** The attribute `name`: one text, or a list of texts. */
void setTexts(hid_t object, const std::string& name, const std::vector<std::string>& texts, bool isList,
              const detail::WholeFile& file) {
    const Handle type(require(H5Tcopy(H5T_C_S1), file), H5Tclose);
    require(H5Tset_size(type.id(), H5T_VARIABLE), file);
    require(H5Tset_cset(type.id(), H5T_CSET_UTF8), file);
    const hsize_t count = texts.size();
    const Handle space(require(isList ? H5Screate_simple(1, &count, nullptr) : H5Screate(H5S_SCALAR), file), H5Sclose);
    std::vector<const char*> values;
    for (const std::string& text : texts) values.push_back(text.c_str());
    values.push_back(nullptr);  // the library wants an address even for an empty list
    setAttribute(object, name, type.id(), space.id(), values.data(), file);
}

/** The attribute `name` with bytes that are no text. */
void setBytes(hid_t object, const std::string& name, const std::string& bytes, const detail::WholeFile& file) {
    const Handle type(require(H5Tvlen_create(H5T_NATIVE_UINT8), file), H5Tclose);
    const Handle space(require(H5Screate(H5S_SCALAR), file), H5Sclose);
    const hvl_t value{bytes.size(), const_cast<char*>(bytes.data())};
    setAttribute(object, name, type.id(), space.id(), &value, file);
}

/** What the log says beside its rows, as attributes of the root. Of several things with one name the
later ones get a number behind it. */
class Opening {
public:
    Opening(hid_t root, const LogReader& reader, const detail::WholeFile& file)
        : root_(root), reader_(reader), file_(file) {
        set("library", reader.library());
        for (const auto& [key, value] : reader.metadata()) set(key, value);
        addAttachments();
    }

    /** Those that came with rows since the last call, such as obstacles that were placed by hand. */
    void addAttachments() {
        for (; attached_ < reader_.attachments().size(); ++attached_)
            set(reader_.attachments()[attached_].name, reader_.attachments()[attached_].data);
    }

private:
    void set(const std::string& wanted, const std::string& value) {
        std::string name = wanted.empty() ? "unnamed" : wanted;
        for (int i = 2; !taken_.insert(name).second; ++i) name = wanted + "_" + std::to_string(i);
        if (value.find('\0') == std::string::npos)
            setTexts(root_, name, {value}, false, file_);
        else
            setBytes(root_, name, value, file_);
    }

    const hid_t root_;
    const LogReader& reader_;
    const detail::WholeFile& file_;
    std::set<std::string> taken_;
    std::size_t attached_ = 0;
};

/** The words of a column that have a number of their own in every file, in that order. */
std::vector<std::string> listWords(const std::string& column) {
    std::vector<std::string> words;
    if (column == "tick.status")
        for (int status = 0; status <= static_cast<int>(FilterStatus::Ended); ++status)
            words.emplace_back(getName(static_cast<FilterStatus>(status)));
    const std::string active = ".active";
    if (column.size() <= active.size() || column.compare(column.size() - active.size(), active.size(), active) != 0)
        return words;
    words.emplace_back(getName(LimitKind::None, LimitSide::Neither));
    for (int kind = 1; kind < countLimitKinds(); ++kind)
        for (LimitSide side : {LimitSide::Lower, LimitSide::Upper})
            words.emplace_back(getName(static_cast<LimitKind>(kind), side));
    return words;
}

/** One column on its way into the file. */
class Column {
public:
    Column(hid_t file, const detail::ExportColumn& column, const detail::WholeFile& target)
        : column_(*column.column), target_(target), words_(listWords(column.name)) {
        const hsize_t none = 0, unlimited = H5S_UNLIMITED, block = kBlockRows;
        const Handle space(require(H5Screate_simple(1, &none, &unlimited), target), H5Sclose);
        const Handle creation(require(H5Pcreate(H5P_DATASET_CREATE), target), H5Pclose);
        require(H5Pset_chunk(creation.id(), 1, &block), target);
        require(H5Pset_shuffle(creation.id()), target);
        require(H5Pset_deflate(creation.id(), kDeflateLevel), target);
        // Chunks are written once, in order: nothing to keep in a cache per column.
        const Handle access(require(H5Pcreate(H5P_DATASET_ACCESS), target), H5Pclose);
        require(H5Pset_chunk_cache(access.id(), 1, kBlockRows * sizeof(double), 1.0), target);
        const Handle links(require(H5Pcreate(H5P_LINK_CREATE), target), H5Pclose);
        require(H5Pset_create_intermediate_group(links.id(), 1), target);
        const hid_t type = column_.isText() ? H5T_STD_U8LE : column_.isInteger() ? H5T_STD_I64LE : H5T_IEEE_F64LE;
        set_ = std::make_unique<Handle>(
            require(H5Dcreate2(file, column.path.c_str(), type, space.id(), links.id(), creation.id(), access.id()),
                    target),
            H5Dclose);
        setTexts(set_->id(), "column", {column.name}, false, target);
        setTexts(set_->id(), "meaning", {detail::explainColumn(column.name)}, false, target);
        if (!column_.isText()) setTexts(set_->id(), "units", {column.unit}, false, target);
    }

    void add(const TickRecord& record) {
        if (column_.isText())
            codes_.push_back(encode(column_.getText(record)));
        else if (column_.isInteger())
            integers_.push_back(column_.getInteger(record));
        else
            numbers_.push_back(column_.getNumber(record));
    }

    void flush() {
        write(H5T_NATIVE_UINT8, codes_);
        write(H5T_NATIVE_INT64, integers_);
        write(H5T_NATIVE_DOUBLE, numbers_);
    }

    void finish() {
        flush();
        if (column_.isText()) setTexts(set_->id(), "words", words_, true, target_);
    }

private:
    std::uint8_t encode(const char* word) {
        const auto known = std::find(words_.begin(), words_.end(), word);
        const auto code = known - words_.begin();
        if (known == words_.end()) words_.emplace_back(word);
        return static_cast<std::uint8_t>(code);
    }

    template <class T>
    void write(hid_t type, std::vector<T>& values) {
        if (values.empty()) return;
        const hsize_t count = values.size(), size = written_ + count;
        require(H5Dset_extent(set_->id(), &size), target_);
        const Handle space(require(H5Dget_space(set_->id()), target_), H5Sclose);
        require(H5Sselect_hyperslab(space.id(), H5S_SELECT_SET, &written_, nullptr, &count, nullptr), target_);
        const Handle memory(require(H5Screate_simple(1, &count, nullptr), target_), H5Sclose);
        require(H5Dwrite(set_->id(), type, memory.id(), space.id(), H5P_DEFAULT, values.data()), target_);
        written_ = size;
        values.clear();
    }

    const LogColumn& column_;
    const detail::WholeFile& target_;
    std::unique_ptr<Handle> set_;
    hsize_t written_ = 0;
    std::vector<std::uint8_t> codes_;
    std::vector<std::int64_t> integers_;
    std::vector<double> numbers_;
    std::vector<std::string> words_;
};

/** Writes the whole file; the driver keeps its first error in `error` and is silent about it. */
void writeHdf5(LogReader& reader, const std::vector<detail::ExportColumn>& named, const detail::WholeFile& pending,
               int& error) {
    const detail::Hdf5Target target{pending.descriptor(), &error};
    const Handle driver(require(detail::registerHdf5Driver(), pending), H5FDunregister);
    const Handle access(require(H5Pcreate(H5P_FILE_ACCESS), pending), H5Pclose);
    require(H5Pset_driver(access.id(), driver.id(), &target), pending);
    Handle file(require(H5Fcreate("log", H5F_ACC_TRUNC, H5P_DEFAULT, access.id()), pending), H5Fclose);
    {
        const Handle root(require(H5Gopen2(file.id(), "/", H5P_DEFAULT), pending), H5Gclose);
        Opening opening(root.id(), reader, pending);
        std::vector<std::unique_ptr<Column>> columns;
        for (const detail::ExportColumn& column : named)
            columns.push_back(std::make_unique<Column>(file.id(), column, pending));
        TickRecord record;
        for (hsize_t rows = 0; error == 0 && reader.read(record);) {
            for (const auto& column : columns) column->add(record);
            if (++rows % kBlockRows == 0)
                for (const auto& column : columns) column->flush();
        }
        for (const auto& column : columns) column->finish();
        if (error == 0) opening.addAttachments();
    }
    require(file.close(), pending);
}

}  // namespace

void exportHdf5(const std::filesystem::path& log, const std::filesystem::path& hdf5, bool isReplacing,
                std::int64_t take) {
    LogReader reader(log);
    reader.keepTake(take);
    const std::vector<detail::ExportColumn> columns = detail::nameExportColumns(reader, log.string());
    detail::WholeFile pending(hdf5, isReplacing);
    const QuietLibrary quiet;
    int error = 0;
    try {
        writeHdf5(reader, columns, pending, error);
    } catch (const Error&) {
        if (error == 0) throw;  // else it only followed from the first
    }
    if (error != 0) throw pending.notWritten(error);
    pending.finish();
}

}  // namespace viable
