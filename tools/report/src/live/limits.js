const KINDS = ['position', 'velocity', 'acceleration', 'jerk', 'torque', 'clearance', 'speed', 'separation'];
// A controller that knows the limits asks for nothing beyond them, and the filter then has nothing to tell. What holds the arm
// back is what it is at while the command is ahead of it: a speed as it moves, all else where it rests.
const AHEAD_M = 0.005;
const AHEAD_RAD = 0.02;
const SHARE = 0.99; // of a velocity limit: at it
const EDGE = 0.002; // of the range of positions: a stop that ends so near the limit ends at it
const KEPT_M = 0.011; // more than the safety distance: so far from what bars its way a controller rests
const STILL_RAD = 0.01; // from where each joint would stop: the arm goes no further

const isFar = (a, b, count, least) => Math.hypot(...Array.from({ length: count }, (_, i) => a[i] - b[i])) > least;

function isAhead(frame, run) {
  if (frame('hand')[0] !== 1) return false;
  if (run.moves !== 'tool') return isFar(frame('target_q'), frame('q'), run.joints.length, AHEAD_RAD);
  const [target, tool] = [frame('target'), frame('tool')];
  const cosine = Math.min(1, Math.abs(target[3] * tool[3] + target[4] * tool[4] + target[5] * tool[5] + target[6] * tool[6]));
  return isFar(target, tool, 3, AHEAD_M) || 2 * Math.acos(cosine) > AHEAD_RAD;
}

const isStill = (frame, run) => !isFar(frame('rest_q'), frame('q'), run.joints.length, STILL_RAD);

/** Which limit a joint of an arm that is behind its command is at. */
function limitAt(frame, i, rests, isClose) {
  const [qd, slowest, fastest] = ['qd', 'velocity_lower', 'velocity_upper'].map((name) => frame(name)[i]);
  if (qd >= SHARE * fastest) return 'velocity_upper';
  if (qd <= SHARE * slowest) return 'velocity_lower';
  if (!rests) return null;
  const [rest, lower, upper] = ['rest_q', 'position_lower', 'position_upper'].map((name) => frame(name)[i]);
  const edge = Number.isFinite(upper - lower) ? EDGE * (upper - lower) : 0;
  if (rest >= upper - edge) return 'position_upper';
  if (rest <= lower + edge) return 'position_lower';
  return isClose ? 'clearance_lower' : null;
}

/** Which limit acts on each joint: "jerk_upper", ..., or null. */
export function limitsOf(frame, run) {
  const isLate = isAhead(frame, run);
  const rests = isLate && isStill(frame, run);
  const isClose = rests && run.environment !== null && frame('clearance')[0] < run.environment.safety_distance_m + KEPT_M;
  return Array.from(frame('limit'), (code, i) => {
    if (code > 0) return `${KINDS[Math.floor((code - 1) / 2)]}_${code % 2 === 1 ? 'lower' : 'upper'}`;
    return isLate ? limitAt(frame, i, rests, isClose) : null;
  });
}
