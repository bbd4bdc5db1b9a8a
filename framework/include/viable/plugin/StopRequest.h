#pragma once

namespace viable {

/** True once the user asked for the end, as by Ctrl-C. For a plugin that waits for something in configure() or reset(): look at
it every 0.2 s or oftener, and give up. In a tick the host decides. With --isolate it is always false: plugins' processes hear
no signals. Real time: no allocation, lock or throw. Thread: any. */
bool isStopRequested() noexcept;

}  // namespace viable
