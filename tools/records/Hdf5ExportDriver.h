#pragma once

#include <hdf5.h>

namespace viable::detail {

/** Where the driver writes, and the first error that it met (an errno; 0: none). */
struct Hdf5Target {
    int descriptor;  ///< open for reading and writing, empty
    int* error;
};

/** Registers a file driver that writes to an Hdf5Target (given to H5Pset_driver). After the first error it
takes everything and writes nothing more: the HDF5 library cannot close a file whose last bytes are refused,
keeps parts of it for good and looks at them again when the program ends. Whoever uses the driver looks at
`error` when the file is closed. Unregister with H5FDunregister; negative when it failed. */
hid_t registerHdf5Driver();

}  // namespace viable::detail
