#pragma once

namespace viable {

/** True once the user asked for the end, as by Ctrl-C. For a plugin that waits for something in configure() or reset(): look at
it every 0.2 s or oftener, and give up. In a tick the host decides. With --isolate it is always false: plugins' processes hear
no signals. Real time: no allocation, lock or throw. Thread: any. */
bool isStopRequested() noexcept;

/** For a real plant that is about to answer Faulted in a tick. The text is the cause, as a sentence about it ("the
robot has been silent for 0.2 s"). The host takes it when that call returns and shows it where it tells why the run
ended. It is copied, up to 511 bytes; the last one counts. Real time: no allocation, lock or throw. Thread: the one
that called the plugin. */
void explainFault(const char* message) noexcept;

}  // namespace viable
