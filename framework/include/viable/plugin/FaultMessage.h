#pragma once

namespace viable {

/** For a real plant that is about to answer Faulted in a tick. The text is the cause, as a sentence about it ("the
robot has been silent for 0.2 s"). The host takes it when that call returns and shows it where it tells why the run
ended. It is copied, up to 511 bytes; the last one counts. Real time: no allocation, lock or throw. Thread: the one
that called the plugin. */
void explainFault(const char* message) noexcept;

}  // namespace viable
