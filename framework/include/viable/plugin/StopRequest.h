#pragma once

namespace viable {

/** True once the user asked for the end, as by Ctrl-C. For a plugin that waits for something in configure() or reset(): it
throws Error then, within 0.2 s. In a tick the host decides. With --isolate it is always false. Real time: no allocation, lock
or throw. Thread: any. */
bool isStopRequested() noexcept;

}  // namespace viable
