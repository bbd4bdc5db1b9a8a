#include "records/Hdf5ExportDriver.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <iterator>
#include <new>

namespace viable::detail {

namespace {

struct File {
    H5FD_t base;  // the library's part: first
    Hdf5Target target;
    haddr_t allocated;  // end of what the library has given out
    haddr_t written;    // end of the file
};

File& get(H5FD_t* file) {
    return *reinterpret_cast<File*>(file);
}

H5FD_t* open(const char*, unsigned, hid_t access, haddr_t) {
    const void* target = H5Pget_driver_info(access);
    if (!target) return nullptr;
    File* file = new (std::nothrow) File{};
    if (!file) return nullptr;
    file->target = *static_cast<const Hdf5Target*>(target);
    return &file->base;
}

herr_t close(H5FD_t* file) {
    delete &get(file);
    return 0;
}

herr_t query(const H5FD_t*, unsigned long* flags) {
    *flags = H5FD_FEAT_AGGREGATE_METADATA | H5FD_FEAT_ACCUMULATE_METADATA | H5FD_FEAT_DATA_SIEVE |
             H5FD_FEAT_AGGREGATE_SMALLDATA | H5FD_FEAT_DEFAULT_VFD_COMPATIBLE;
    return 0;
}

herr_t setAllocated(H5FD_t* file, H5FD_mem_t, haddr_t end) {
    get(file).allocated = end;
    return 0;
}

herr_t read(H5FD_t* handle, H5FD_mem_t, hid_t, haddr_t at, std::size_t size, void* to) {
    char* next = static_cast<char*>(to);
    while (size > 0) {
        const ssize_t taken = ::pread(get(handle).target.descriptor, next, size, static_cast<off_t>(at));
        if (taken < 0 && errno == EINTR) continue;
        if (taken < 0) return -1;
        if (taken == 0) {  // beyond the end: zeros, as the library expects
            std::fill_n(next, size, '\0');
            break;
        }
        next += taken;
        at += static_cast<haddr_t>(taken);
        size -= static_cast<std::size_t>(taken);
    }
    return 0;
}

herr_t write(H5FD_t* handle, H5FD_mem_t, hid_t, haddr_t at, std::size_t size, const void* from) {
    File& file = get(handle);
    file.written = std::max<haddr_t>(file.written, at + size);
    const char* next = static_cast<const char*>(from);
    while (size > 0 && *file.target.error == 0) {
        const ssize_t taken = ::pwrite(file.target.descriptor, next, size, static_cast<off_t>(at));
        if (taken < 0 && errno == EINTR) continue;
        if (taken <= 0) {
            *file.target.error = taken < 0 ? errno : EIO;
            break;
        }
        next += taken;
        at += static_cast<haddr_t>(taken);
        size -= static_cast<std::size_t>(taken);
    }
    return 0;
}

herr_t truncate(H5FD_t* handle, hid_t, hbool_t) {
    File& file = get(handle);
    if (file.written == file.allocated) return 0;
    if (*file.target.error == 0 && ::ftruncate(file.target.descriptor, static_cast<off_t>(file.allocated)) != 0)
        *file.target.error = errno;
    file.written = file.allocated;
    return 0;
}

}  // namespace

hid_t registerHdf5Driver() {
    static const H5FD_class_t driver = [] {
        constexpr H5FD_mem_t kMap[] = H5FD_FLMAP_DICHOTOMY;
        H5FD_class_t d{};
#ifdef H5FD_CLASS_VERSION  // HDF5 1.14
        d.version = H5FD_CLASS_VERSION;
        d.value = 512;  // the first that is free for everybody
#endif
        d.name = "viable";
        d.maxaddr = haddr_t{1} << 62;
        d.fc_degree = H5F_CLOSE_WEAK;
        d.fapl_size = sizeof(Hdf5Target);
        d.open = open;
        d.close = close;
        d.query = query;
        d.get_eoa = [](const H5FD_t* file, H5FD_mem_t) { return reinterpret_cast<const File*>(file)->allocated; };
        d.set_eoa = setAllocated;
        d.get_eof = [](const H5FD_t* file, H5FD_mem_t) { return reinterpret_cast<const File*>(file)->written; };
        d.read = read;
        d.write = write;
        d.truncate = truncate;
        std::copy(std::begin(kMap), std::end(kMap), d.fl_map);
        return d;
    }();
    return H5FDregister(&driver);
}

}  // namespace viable::detail
