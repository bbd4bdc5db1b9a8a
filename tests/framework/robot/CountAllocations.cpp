// Opts this test program in: it has its malloc counted.
#include "AllocationCounter.cpp"
