// A controller that knows the limits asks for nothing beyond them, and the filter then has nothing to tell. What holds the arm
// back is what it is at while the command is ahead of it: a joint at its limit, and what is near where the arm rests.
const AHEAD_M = 0.005;
const AHEAD_RAD = 0.02;
const SHARE = 0.99; // of a velocity limit: at it
const EDGE = 0.002; // of the range of positions: so near the limit a joint is at it
const KEPT_M = 0.011; // more than the safety distance: so far from what bars its way a controller rests
const STILL_RADPS = 0.01;

const isFar = (a, b, count, least) => Math.hypot(...Array.from({ length: count }, (_, i) => a[i] - b[i])) > least;

function isAhead(frame, run) {
  if (frame('hand')[0] !== 1) return false;
  if (run.moves !== 'tool') return isFar(frame('target_q'), frame('q'), run.joints.length, AHEAD_RAD);
  const [target, tool] = [frame('target'), frame('tool')];
  const cosine = Math.min(1, Math.abs(target[3] * tool[3] + target[4] * tool[4] + target[5] * tool[5] + target[6] * tool[6]));
  return isFar(target, tool, 3, AHEAD_M) || 2 * Math.acos(cosine) > AHEAD_RAD;
}

/** Whether the command goes on beyond the end that a joint is at; of a tool's nobody knows. */
const asksBeyond = (frame, run, i, side) => run.moves === 'tool' || side * (frame('target_q')[i] - frame('q')[i]) > AHEAD_RAD;

/** Which limit a joint of an arm that is behind its command is at. */
function limitAt(frame, run, i, isClose) {
  const [qd, slowest, fastest] = ['qd', 'velocity_lower', 'velocity_upper'].map((name) => frame(name)[i]);
  if (qd >= SHARE * fastest) return 'velocity_upper';
  if (qd <= SHARE * slowest) return 'velocity_lower';
  const [q, lower, upper] = ['q', 'position_lower', 'position_upper'].map((name) => frame(name)[i]);
  const edge = Number.isFinite(upper - lower) ? EDGE * (upper - lower) : 0;
  if (q >= upper - edge && qd > -STILL_RADPS && asksBeyond(frame, run, i, 1)) return 'position_upper';
  if (q <= lower + edge && qd < STILL_RADPS && asksBeyond(frame, run, i, -1)) return 'position_lower';
  return isClose ? 'clearance_lower' : null;
}

/** Which limit acts on each joint: "jerk_upper", ..., or null. */
export function limitsOf(frame, run) {
  const isLate = isAhead(frame, run);
  const isStill = Array.from(frame('qd')).every((qd) => Math.abs(qd) < STILL_RADPS);
  const isClose = isLate && isStill && run.environment !== null && frame('clearance')[0] < run.environment.safety_distance_m + KEPT_M;
  return Array.from(frame('limit'), (code, i) => {
    if (code > 0) return `${run.limits[Math.floor((code - 1) / 2)]}_${code % 2 === 1 ? 'lower' : 'upper'}`;
    return isLate ? limitAt(frame, run, i, isClose) : null;
  });
}
