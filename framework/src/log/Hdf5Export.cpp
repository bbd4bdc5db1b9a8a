#include <hdf5.h>

#include <algorithm>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "log/PendingFile.h"
#include "viable/log/LogExport.h"
#include "viable/log/LogReader.h"

namespace viable {

namespace {

constexpr hsize_t kBlockRows = 4096;
constexpr unsigned kCompression = 4;

/** The library's answer, or an Error: all it can fail at here is writing. */
template <class Id>
Id require(Id id, const std::filesystem::path& file) {
    if (id >= 0) return id;
    throw Error(ErrorKind::LogNotWritten, file.string(), "the HDF5 file cannot be written",
                "Choose a folder that has room.");
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
    /** Closes now; false when that failed. */
    bool close() {
        const hid_t id = id_;
        id_ = -1;
        return close_(id) >= 0;
    }

private:
    hid_t id_;
    herr_t (*close_)(hid_t);
};

/** Text attributes: one, or a list. */
void setTexts(hid_t object, const std::string& name, const std::vector<std::string>& texts,
              bool isList, const std::filesystem::path& file) {
    std::size_t longest = 1;
    for (const std::string& text : texts) longest = std::max(longest, text.size());
    const Handle type(require(H5Tcopy(H5T_C_S1), file), H5Tclose);
    require(H5Tset_size(type.id(), longest), file);
    require(H5Tset_cset(type.id(), H5T_CSET_UTF8), file);
    require(H5Tset_strpad(type.id(), H5T_STR_NULLPAD), file);
    const hsize_t count = texts.size();
    const Handle space(
        require(isList ? H5Screate_simple(1, &count, nullptr) : H5Screate(H5S_SCALAR), file),
        H5Sclose);
    // An attribute lives in its object's header, which takes 64 KiB: longer text becomes a data set.
    const bool fits = longest * texts.size() < 60000;
    const Handle place(require(fits ? H5Acreate2(object, name.c_str(), type.id(), space.id(),
                                                 H5P_DEFAULT, H5P_DEFAULT)
                                    : H5Dcreate2(object, name.c_str(), type.id(), space.id(),
                                                 H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
                               file),
                       fits ? H5Aclose : H5Dclose);
    std::string bytes(longest * std::max<std::size_t>(texts.size(), 1), '\0');
    for (std::size_t i = 0; i < texts.size(); ++i)
        std::memcpy(&bytes[i * longest], texts[i].data(), texts[i].size());
    require(fits ? H5Awrite(place.id(), type.id(), bytes.data())
                 : H5Dwrite(place.id(), type.id(), H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes.data()),
            file);
}

/** The column's place: the source and the joint become groups. */
std::string makePath(const std::string& column) {
    std::string path = "/" + column;
    for (int dots = 0; dots < 2; ++dots) {
        const std::size_t dot = path.find('.');
        if (dot != std::string::npos) path[dot] = '/';
    }
    return path;
}

/** One column on its way into the file. */
class Column {
public:
    Column(hid_t file, const LogColumn& column, const std::filesystem::path& name)
        : column_(column), name_(name) {
        const hsize_t none = 0, unlimited = H5S_UNLIMITED, block = kBlockRows;
        const Handle space(require(H5Screate_simple(1, &none, &unlimited), name), H5Sclose);
        const Handle creation(require(H5Pcreate(H5P_DATASET_CREATE), name), H5Pclose);
        require(H5Pset_chunk(creation.id(), 1, &block), name);
        require(H5Pset_shuffle(creation.id()), name);
        require(H5Pset_deflate(creation.id(), kCompression), name);
        const Handle links(require(H5Pcreate(H5P_LINK_CREATE), name), H5Pclose);
        require(H5Pset_create_intermediate_group(links.id(), 1), name);
        const hid_t type = column.isText()      ? H5T_STD_U8LE
                           : column.isInteger() ? H5T_STD_I64LE
                                                : H5T_IEEE_F64LE;
        set_ = std::make_unique<Handle>(
            require(H5Dcreate2(file, makePath(column.name()).c_str(), type, space.id(), links.id(),
                               creation.id(), H5P_DEFAULT),
                    name),
            H5Dclose);
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
        if (column_.isText()) setTexts(set_->id(), "words", words_, true, name_);
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
        require(H5Dset_extent(set_->id(), &size), name_);
        const Handle space(require(H5Dget_space(set_->id()), name_), H5Sclose);
        require(
            H5Sselect_hyperslab(space.id(), H5S_SELECT_SET, &written_, nullptr, &count, nullptr),
            name_);
        const Handle memory(require(H5Screate_simple(1, &count, nullptr), name_), H5Sclose);
        require(H5Dwrite(set_->id(), type, memory.id(), space.id(), H5P_DEFAULT, values.data()),
                name_);
        written_ = size;
        values.clear();
    }

    const LogColumn& column_;
    const std::filesystem::path& name_;
    std::unique_ptr<Handle> set_;
    hsize_t written_ = 0;
    std::vector<std::uint8_t> codes_;
    std::vector<std::int64_t> integers_;
    std::vector<double> numbers_;
    std::vector<std::string> words_;
};

}  // namespace

void exportHdf5(const std::filesystem::path& log, const std::filesystem::path& hdf5) {
    LogReader reader(log);
    detail::PendingFile pending(hdf5);
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // errors are ours to report
    Handle file(
        require(H5Fcreate(pending.path().c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), hdf5),
        H5Fclose);
    {
        const Handle root(require(H5Gopen2(file.id(), "/", H5P_DEFAULT), hdf5), H5Gclose);
        setTexts(root.id(), "library", {reader.library()}, false, hdf5);
        for (const auto& [key, value] : reader.metadata())
            setTexts(root.id(), key, {value}, false, hdf5);
        for (const LogAttachment& attachment : reader.attachments())
            setTexts(root.id(), attachment.name, {attachment.data}, false, hdf5);
        std::vector<std::unique_ptr<Column>> columns;
        for (const LogColumn& column : reader.columns())
            columns.push_back(std::make_unique<Column>(file.id(), column, hdf5));
        TickRecord record;
        for (hsize_t rows = 0; reader.read(record);) {
            for (const auto& column : columns) column->add(record);
            if (++rows % kBlockRows == 0)
                for (const auto& column : columns) column->flush();
        }
        for (const auto& column : columns) column->finish();
    }
    if (!file.close()) require(hid_t{-1}, hdf5);
    pending.finish();
}

}  // namespace viable
