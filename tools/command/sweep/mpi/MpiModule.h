#pragma once

// The functions of viable_mpi.so, the only part of viable that is linked to MPI. The program opens it when mpirun has
// started it, and does without MPI otherwise. One thread.

extern "C" {

/** Joins the others. Once, first. 0: done. */
int viable_mpi_begin(int* rank, int* size);
/** Sends bytes to a rank; returns when they may be changed. */
void viable_mpi_send(int rank, const char* bytes, unsigned long size);
/** Waits for a message of any rank and hands its bytes to `take`. Sleeps meanwhile, as the processor is for the runs.
Returns the sender, or -1 as soon as `goOn` says 0. */
int viable_mpi_receive(int (*goOn)(), void (*take)(void* context, const char* bytes, unsigned long size),
                       void* context);
/** Leaves; waits for the others to do so. Once, last. */
void viable_mpi_end();
}
