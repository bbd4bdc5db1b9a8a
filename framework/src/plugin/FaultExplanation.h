#pragma once

namespace viable::detail {

/** What explainFault() told since the last call; empty: nothing. Valid until the next explainFault() of this thread. */
const char* readFaultExplanation() noexcept;

}  // namespace viable::detail
