"""Reads an exported log with h5py and fails unless it says the same as the CSV of the same log:
    python3 read_hdf5.py FILE.h5 FILE.csv
Every column of the CSV is a dataset of equal values, with its unit; with pandas, also as a table. Exit code 77:
h5py or numpy is not installed."""

import csv
import sys

try:
    import h5py
    import numpy
except ImportError as missing:
    print(f"skipped: {missing.name} is not installed (Debian: python3-h5py)")
    sys.exit(77)
try:
    import pandas
except ImportError:
    pandas = None

UNITS = {
    "rad": "rad",
    "radps": "rad/s",
    "radps2": "rad/s^2",
    "radps3": "rad/s^3",
    "Nm": "Nm",
    "m": "m",
    "mps": "m/s",
    "mps2": "m/s^2",
    "mps3": "m/s^3",
    "N": "N",
    "s": "s",
    "us": "us",
}


def require(condition, text):
    if not condition:
        sys.exit(f"read_hdf5.py: {text}")


def make_path(column):
    """`nominal.joint0.q_rad` is /nominal/joint0/q_rad; dots of a joint's name stay."""
    first, last = column.find("."), column.rfind(".")
    if first < 0:
        return "/" + column
    if first == last:
        return "/" + column.replace(".", "/")
    return f"/{column[:first]}/{column[first + 1:last]}/{column[last + 1:]}"


def list_datasets(file):
    found = {}

    def visit(path, item):
        if isinstance(item, h5py.Dataset):
            found["/" + path] = item

    file.visititems(visit)
    return found


def check_column(name, texts, dataset):
    """The dataset's values, compared with the texts of the CSV bit by bit (all NaN are one)."""
    require(dataset.shape == (len(texts),), f"{name}: {dataset.shape} values for {len(texts)} rows")
    require(dataset.attrs.get("column") == name, f"{name}: its attribute `column` is {dataset.attrs.get('column')!r}")
    meaning = dataset.attrs.get("meaning")
    require(isinstance(meaning, str) and len(meaning) > 10 and "library adds" not in meaning, f"{name}: means {meaning!r}")
    if "words" in dataset.attrs:
        require(dataset.dtype == numpy.uint8, f"{name}: words of type {dataset.dtype}")
        require("units" not in dataset.attrs, f"{name}: words with a unit")
        words = list(dataset.attrs["words"])
        require(all(isinstance(word, str) and word for word in words), f"{name}: words {words!r}")
        require(len(set(words)) == len(words), f"{name}: a word twice in {words!r}")
        values = numpy.array(words, dtype=object)[dataset[:]]
        require(list(values) == texts, f"{name}: other words than in the CSV")
        return values
    unit = dataset.attrs.get("units")
    suffix = name.rsplit(".", 1)[-1].rsplit("_", 1)
    expected = UNITS.get(suffix[1], "1") if len(suffix) == 2 else "1"
    require(isinstance(unit, str) and unit == expected, f"{name}: its unit is {unit!r} instead of {expected!r}")
    values = dataset[:]
    if dataset.dtype == numpy.int64:
        require([str(value) for value in values] == texts, f"{name}: other integers than in the CSV")
        return values
    require(dataset.dtype == numpy.float64, f"{name}: type {dataset.dtype}")
    table = numpy.array([float(text) for text in texts])
    same = (values.view(numpy.uint64) == table.view(numpy.uint64)) | (numpy.isnan(values) & numpy.isnan(table))
    require(same.all(), f"{name}: row {numpy.argmin(same)} is {values[numpy.argmin(same)] if len(same) else None!r}")
    return values


def check_frame(values, path):
    """The same through pandas, as a user reads both."""
    from_hdf5 = pandas.DataFrame(values)
    from_csv = pandas.read_csv(path, float_precision="round_trip", keep_default_na=False, na_values=["nan", "-nan"])
    pandas.testing.assert_frame_equal(from_hdf5, from_csv, check_exact=True, check_dtype=False)  # 2.0 may be read as 2
    require(from_hdf5["time_s"].is_monotonic_increasing, "time_s goes back")


def main(hdf5_path, csv_path):
    with open(csv_path, newline="", encoding="utf-8") as stream:
        header, *rows = csv.reader(stream)
    require(rows, "the CSV has no rows: nothing to compare")
    require(len(set(header)) == len(header), "a column of the CSV is there twice")
    with h5py.File(hdf5_path, "r") as file:
        library = file.attrs.get("library")
        require(isinstance(library, str) and library.startswith("viable "), f"it was written by {library!r}")
        experiment = file.attrs.get("experiment.yaml")
        require(isinstance(experiment, str) and "schema: 1" in experiment, "no experiment.yaml among its attributes")
        datasets = list_datasets(file)
        paths = [make_path(name) for name in header]
        require(sorted(datasets) == sorted(paths), f"other columns: {sorted(set(datasets) ^ set(paths))}")
        values = {
            name: check_column(name, [row[i] for row in rows], datasets[paths[i]]) for i, name in enumerate(header)
        }
    if pandas:
        check_frame(values, csv_path)
    print(f"{hdf5_path}: {len(header)} columns of {len(rows)} rows are those of the CSV" + (", also in pandas" if pandas else ""))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        sys.exit(2)
    main(sys.argv[1], sys.argv[2])
