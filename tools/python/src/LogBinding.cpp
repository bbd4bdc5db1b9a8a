#include <pybind11/stl.h>

#include "Arrays.h"
#include "records/LogReader.h"

namespace viable::python {

namespace {

/** What a column is read into. */
struct ColumnValues {
    const LogColumn* column;
    std::vector<double> numbers;
    std::vector<std::int64_t> integers;
    std::vector<const char*> texts;

    void add(const TickRecord& record) {
        if (column->isText())
            texts.push_back(column->getText(record));
        else if (column->isInteger())
            integers.push_back(column->getInteger(record));
        else
            numbers.push_back(column->getNumber(record));
    }
    py::object make() const {
        if (column->isText()) {
            py::list words(texts.size());
            std::map<const char*, py::str> known;  // few, and literals
            for (std::size_t i = 0; i < texts.size(); ++i)
                words[i] = known.try_emplace(texts[i], py::str(texts[i])).first->second;
            return py::module_::import("numpy").attr("array")(words, py::arg("dtype") = "U");
        }
        if (column->isInteger())
            return py::array_t<std::int64_t>(static_cast<py::ssize_t>(integers.size()), integers.data());
        return py::array_t<double>(static_cast<py::ssize_t>(numbers.size()), numbers.data());
    }
};

/** How many rows are read between two looks for a signal. */
constexpr int kRowsPerLook = 20000;

/** The columns `names`, in one pass over the file. */
py::dict readColumns(const std::string& file, const std::vector<std::string>& names) {
    LogReader reader(file);
    std::vector<ColumnValues> wanted;
    for (const std::string& name : names)
        for (const LogColumn& column : reader.columns())
            if (column.name() == name) wanted.push_back({&column, {}, {}, {}});
    {
        const py::gil_scoped_release release;
        auto record = std::make_unique<TickRecord>();
        for (int row = 1; reader.read(*record); ++row) {
            for (ColumnValues& values : wanted) values.add(*record);
            if (row % kRowsPerLook != 0) continue;
            const py::gil_scoped_acquire acquire;
            if (PyErr_CheckSignals() != 0) throw py::error_already_set();
        }
    }
    py::dict columns;
    for (const ColumnValues& values : wanted) columns[py::str(values.column->name())] = values.make();
    return columns;
}

py::dict openLog(const std::string& file) {
    const LogReader reader(file);
    std::vector<std::string> names;
    for (const LogColumn& column : reader.columns()) names.push_back(column.name());
    py::dict opening, attachments;
    for (const LogAttachment& attachment : reader.attachments())
        attachments[py::str(attachment.name)] = py::bytes(attachment.data);
    opening["columns"] = names;
    opening["joints"] = reader.layout().jointNames;
    opening["metadata"] = reader.metadata();
    opening["attachments"] = attachments;
    opening["library"] = reader.library();
    opening["complete"] = reader.isComplete();
    return opening;
}

}  // namespace

void bindLog(py::module_& module) {
    module.def("open_log", &openLog, py::arg("file"), "What a log says before its first row.");
    module.def("read_log", &readColumns, py::arg("file"), py::arg("names"), "Columns of a log, each an array (rows,).");
}

}  // namespace viable::python
