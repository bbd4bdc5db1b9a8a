const KINDS = ['position', 'velocity', 'acceleration', 'jerk', 'torque', 'clearance', 'speed', 'separation'];

/** Which limit acts on each joint: "jerk_upper", ..., or null. */
export const limitsOf = (frame) =>
  Array.from(frame('limit'), (code) =>
    code > 0 ? `${KINDS[Math.floor((code - 1) / 2)]}_${code % 2 === 1 ? 'lower' : 'upper'}` : null,
  );
