#pragma once

#include "SweepSupervisor.h"

namespace viable {

/** This process's number among those that mpirun has started; -1: it did not, or this one only. */
int findMpiRank();

/** Rank 0: hands out the runs to the other ranks and calls `onRow` with each row that they send. Returns false when it ended
early because of `stop`. A rank that dies takes all with it, as MPI has it: what was stored is whole, and the same command
goes on from there. Throws Error where a rank has another sweep, or the module is not there. */
bool serveMpiRuns(const SweepTask& task, const std::vector<std::int64_t>& runs, const std::atomic<int>& stop,
                  const std::function<void(SweepRow&&)>& onRow, const std::function<void()>& onLook);

/** The other ranks: runs what rank 0 hands out, `jobs` at a time, until there is no more. The runs have processes made
before MPI begins, as it has threads. Throws Error. */
void workForMpi(const SweepTask& task, int jobs, double timeout_s);

}  // namespace viable
