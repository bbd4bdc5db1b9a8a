#include "MpiModule.h"

#include <mpi.h>
#include <time.h>

#include <vector>

constexpr int kTag = 1;
constexpr timespec kNap{0, 200000};

int viable_mpi_begin(int* rank, int* size) {
    if (MPI_Init(nullptr, nullptr) != MPI_SUCCESS) return 1;
    MPI_Comm_rank(MPI_COMM_WORLD, rank);
    MPI_Comm_size(MPI_COMM_WORLD, size);
    return 0;
}

void viable_mpi_send(int rank, const char* bytes, unsigned long size) {
    MPI_Send(bytes, static_cast<int>(size), MPI_BYTE, rank, kTag, MPI_COMM_WORLD);
}

int viable_mpi_receive(int (*goOn)(), void (*take)(void*, const char*, unsigned long), void* context) {
    for (;;) {
        int isThere = 0;
        MPI_Status status;
        MPI_Iprobe(MPI_ANY_SOURCE, kTag, MPI_COMM_WORLD, &isThere, &status);
        if (isThere) {
            int size = 0;
            MPI_Get_count(&status, MPI_BYTE, &size);
            std::vector<char> bytes(static_cast<std::size_t>(size));
            MPI_Recv(bytes.data(), size, MPI_BYTE, status.MPI_SOURCE, kTag, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
            take(context, bytes.data(), bytes.size());
            return status.MPI_SOURCE;
        }
        if (!goOn()) return -1;
        nanosleep(&kNap, nullptr);
    }
}

void viable_mpi_end() {
    MPI_Finalize();
}
