/** Moves the scrubber while the replay plays. */
export function createPlayer(state) {
  let last = null;

  function frame(now) {
    if (!state.playing) return;
    const elapsed = last === null ? 0 : Math.min(now - last, 250) / 1000; // a page in the background does not jump
    last = now;
    state.setTime(state.time + elapsed * state.speed);
    if (state.time >= state.run.tMax) state.setPlaying(false);
    else requestAnimationFrame(frame);
  }

  state.on('play', () => {
    last = null;
    if (state.playing) requestAnimationFrame(frame);
  });
}
