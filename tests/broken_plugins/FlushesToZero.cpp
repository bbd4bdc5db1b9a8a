#include <cfenv>

#include "BrokenPlugin.h"
#if defined(__SSE__)
#include <pmmintrin.h>
#include <xmmintrin.h>
#endif

// What gcc links into every shared library that is built with -ffast-math.
__attribute__((constructor)) static void setFastMath() {
#if defined(__SSE__)
    _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
    _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
#else
    std::fesetround(FE_TOWARDZERO);
#endif
}

VIABLE_PLUGIN(viable::SafetyFilter, broken::Filter, "flushes_to_zero", "Changes the arithmetic.", viable::NoOptions)
