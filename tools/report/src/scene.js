import { BackSide, BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, Color, CylinderGeometry } from 'three';
import { DynamicDrawUsage, Group, Line, LineBasicMaterial, Matrix4, Mesh, MeshStandardMaterial, Quaternion } from 'three';
import { SphereGeometry, SRGBColorSpace, Vector3 } from 'three';
import { mergeGeometries } from 'three/examples/jsm/utils/BufferGeometryUtils.js';
import { DataError } from './blocks.js';

/** The surface of each link in its frame, made once for all arms; null: a link without shapes. */
export function readSurfaces(run) {
  const { links } = run.scene;
  if (!links.some(({ shapes }) => shapes?.length > 0)) return makeRods(run).map(join);
  return links.map((link, i) =>
    join((link.shapes ?? []).map((shape, k) => readShape(run, shape, `scene.links[${i}].shapes[${k}]`)), i),
  );
}

/** Shapes as one surface: without a graphics card it is the number of things to draw that takes the time. Takes them over. */
function join(shapes, link) {
  if (shapes.length === 0) return null;
  const one = new Vector3(1, 1, 1);
  const parts = shapes.map(({ geometry, position, orientation }) => {
    if (!geometry.index) geometry.setIndex([...Array(geometry.attributes.position.count).keys()]);
    return geometry.deleteAttribute('uv').applyMatrix4(new Matrix4().compose(position, orientation, one));
  });
  const surface = parts.length === 1 ? parts[0] : mergeGeometries(parts);
  if (!surface) throw new DataError(`scene.links[${link}].shapes: cannot be drawn together.`);
  return surface;
}

/** For a robot without shapes: a rod from each link to those that it carries, a hub where a joint moves it. */
function makeRods({ scene: { links } }) {
  const size = Math.max(...links.map(({ origin }) => new Vector3(...origin.xyz).length())) || 1;
  const radius = 0.035 * size;
  return links.map((link, i) => {
    const shapes = links
      .filter(({ parent, origin }) => parent === i && new Vector3(...origin.xyz).length() > 1e-9)
      .map(({ origin }) => rod(new Vector3(), new Vector3(...origin.xyz), radius));
    if (link.joint >= 0) {
      const half = new Vector3(...(link.axis ?? [0, 0, 1])).setLength(1.6 * radius);
      const hub = rod(half.clone().negate(), half, 1.8 * radius);
      hub.geometry = new CylinderGeometry(1.8 * radius, 1.8 * radius, 3.2 * radius, 32); // along y, like a capsule
      shapes.push(hub);
    }
    return shapes;
  });
}

/** Steps along a quarter of a circle and around: the edge of a capsule that is 100 pixels wide is wrong by less than half a
 *  pixel. */
const ROUND = [6, 24];

function rod(from, to, radius) {
  const along = to.clone().sub(from);
  const orientation = new Quaternion().setFromUnitVectors(
    new Vector3(0, 1, 0),
    along.lengthSq() > 0 ? along.clone().normalize() : new Vector3(0, 1, 0),
  );
  const geometry = new CapsuleGeometry(radius, along.length(), ...ROUND); // along y
  return { geometry, position: from.clone().addScaledVector(along, 0.5), orientation };
}

/** The geometry of a shape in the data, and where it is. */
export function readShape(run, shape, where) {
  const { type, radius } = shape;
  const here = (geometry) => ({ geometry, ...readPose(shape.pose) });
  if (type === 'capsule') return rod(new Vector3(...shape.from), new Vector3(...shape.to), radius);
  if (type === 'box') return here(new BoxGeometry(...shape.size));
  if (type === 'sphere') return here(new SphereGeometry(radius, 32, 20));
  if (type === 'cylinder') return here(new CylinderGeometry(radius, radius, shape.length, 32).rotateX(Math.PI / 2)); // was along y
  if (type !== 'mesh') throw new DataError(`${where}: unknown shape ${type}.`);
  const geometry = new BufferGeometry();
  const read = (key) => run.array(shape[key], `${where}.${key}`);
  geometry.setAttribute('position', new BufferAttribute(Float32Array.from(read('positions')), 3));
  if (shape.indices) geometry.setIndex(new BufferAttribute(Uint32Array.from(read('indices')), 1));
  geometry.computeVertexNormals();
  return here(geometry);
}

export function readPose(pose) {
  const [w, x, y, z] = pose?.quat ?? [1, 0, 0, 0];
  return { position: new Vector3(...(pose?.xyz ?? [0, 0, 0])), orientation: new Quaternion(x, y, z, w) };
}

/** Puts an object there. */
export function placed(object, { position, orientation }) {
  object.position.copy(position);
  object.quaternion.copy(orientation);
  return object;
}

/** The link whose way is drawn: the tool, else the last fixed one without shapes, else the last. */
function findTool({ tool, links }) {
  if (Number.isInteger(tool) && links[tool]) return tool;
  const bare = links.findLastIndex(({ joint, parent, shapes }) => joint < 0 && parent >= 0 && !shapes?.length);
  return bare >= 0 ? bare : links.length - 1;
}

/** An arm in three's scene: a frame per link, moved by joint angles. */
export class Arm {
  #links;
  #tool;
  #hulls = null;

  /**
   * @param {{outline: number, opacity: number}} look outline more than 0: not the arm itself, but an outline of it so far
   *   [m] around; where another arm lies in the same place, it is seen as its edge. opacity less than 1: one can look
   *   through it, as through one body, and it yields to another arm in the same place
   */
  constructor(run, surfaces, { outline = 0, opacity = 1 } = {}) {
    this.root = new Group();
    this.#tool = findTool(run.scene);
    const { links } = run.scene;
    const carrier = (i) => (i < 0 ? -1 : links[i].joint >= 0 ? links[i].joint : carrier(links[i].parent));
    this.#links = links.map((link, i) => {
      const origin = placed(new Group(), readPose(link.origin));
      const frame = new Group(); // moves in its origin
      origin.add(frame);
      const material = new MeshStandardMaterial(
        outline > 0 ? { roughness: 1, side: BackSide, emissiveIntensity: 0.6 } : { roughness: 0.62, metalness: 0.05 },
      );
      if (opacity < 1) Object.assign(material, { opacity, ...BEHIND });
      const surface = surfaces[i];
      if (surface) {
        const mesh = new Mesh(outline > 0 ? inflated(surface, outline) : surface, material);
        frame.add(...(opacity < 1 ? asOneBody(mesh, ORDER.stop) : [mesh]));
      }
      const axis = new Vector3(...(link.axis ?? [0, 0, 1])).normalize();
      return {
        frame,
        origin,
        surface,
        material,
        base: new Color(),
        axis,
        joint: link.joint,
        movedBy: carrier(i),
        isOutline: outline > 0,
        linear: run.joints[link.joint]?.linear,
        own: link.color,
      };
    });
    links.forEach(({ parent }, i) => (this.#links[parent]?.frame ?? this.root).add(this.#links[i].origin));
  }

  /** Where arms coincide, the one of the lowest layer is seen. */
  setLayer(layer) {
    for (const { material } of this.#links)
      Object.assign(material, {
        polygonOffset: layer > 0,
        polygonOffsetFactor: 3 * layer,
        polygonOffsetUnits: 30 * layer,
      });
  }

  /** Takes the joint positions from `q[at]` on. */
  pose(q, at = 0) {
    for (const { frame, axis, joint, linear } of this.#links) {
      if (joint < 0) continue;
      if (linear) frame.position.copy(axis).multiplyScalar(q[at + joint]);
      else frame.quaternion.setFromAxisAngle(axis, q[at + joint]);
    }
  }

  /** Paints the links: in `colour`, or where that is null in their own, else in `neutral`. */
  paint(colour, neutral) {
    for (const { base, own } of this.#links) {
      if (colour) base.set(colour);
      else if (own) base.setRGB(own[0], own[1], own[2], SRGBColorSpace);
      else base.set(neutral);
    }
    this.tint(() => null);
  }

  /** Tints what a joint moves, up to the next one, in the colour that `colourOf` the joint gives, if any. */
  tint(colourOf) {
    for (const { material, base, movedBy, isOutline } of this.#links) {
      const colour = movedBy >= 0 ? colourOf(movedBy) : null;
      material.color.copy(base);
      if (isOutline) material.emissive.copy(base);
      if (colour) material.color.lerp(new Color(colour), 0.6);
    }
  }

  /** Colours each link by a share of 1, along the colours of a scale. */
  colourByShares(shares, scale) {
    const steps = scale.map((colour) => new Color(colour));
    this.#links.forEach(({ material }, i) => {
      const at = Math.min(Math.max(shares[i], 0), 1) * (steps.length - 1);
      const step = Math.min(Math.floor(at), steps.length - 2);
      material.color.copy(steps[step]).lerp(steps[step + 1], at - step);
    });
  }

  /** How fast the surface of each link is at most on the way from one pose to another in dt seconds [m/s]; the arm is left in
   *  the second one. */
  speeds(from, to, dt) {
    this.#hulls ??= this.#links.map(({ surface }) => (surface ? outermost(surface) : []));
    const place = () => {
      this.root.updateMatrixWorld(true);
      return this.#links.map(({ frame }, i) =>
        this.#hulls[i].map((point) => point.clone().applyMatrix4(frame.matrixWorld)),
      );
    };
    this.pose(from);
    const before = place();
    this.pose(to);
    return place().map((points, i) => Math.max(0, ...points.map((point, k) => point.distanceTo(before[i][k]))) / dt);
  }

  /** Where the tool is. */
  toolPosition(target) {
    this.root.updateMatrixWorld(true);
    return this.#links[this.#tool].frame.getWorldPosition(target);
  }
}

/** The points of a link's surface that are farthest out in 26 directions: of a motion of the link, nearly the fastest. */
function outermost(surface) {
  const { position } = surface.attributes;
  if (position.count === 0) return [];
  const points = Array.from({ length: position.count }, (_, i) => new Vector3().fromBufferAttribute(position, i));
  const steps = [-1, 0, 1];
  const all = steps.flatMap((x) => steps.flatMap((y) => steps.map((z) => new Vector3(x, y, z))));
  const directions = all.filter((way) => way.length() > 0);
  const found = directions.map((way) => points.reduce((best, one) => (one.dot(way) > best.dot(way) ? one : best)));
  return [...new Set(found)];
}

/** What one can look through, in the order of drawing: solids, arms at rest, maps, and what marks a place. */
export const ORDER = { solid: 1, stop: 2, map: 4, mark: 6 };

/** Yields to another surface in the same place. */
const BEHIND = { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 8 };

/**
 * A mesh of surfaces behind each other of which only the foremost is seen, however opaque it is: one pass finds it, one
 * paints it. Every mesh of the body must be drawn with the same order.
 */
export function asOneBody(mesh, order) {
  const depth = mesh.clone();
  depth.material = mesh.material.clone(); // the same program: the same depths
  Object.assign(depth.material, { transparent: true, colorWrite: false });
  depth.renderOrder = order;
  Object.assign(mesh.material, { transparent: true, depthWrite: false });
  mesh.renderOrder = order + 1;
  return [depth, mesh];
}

const hulls = new WeakMap();

/** The surface, moved outwards. */
function inflated(geometry, distance) {
  if (!hulls.has(geometry)) {
    const hull = geometry.clone();
    const { position, normal } = hull.attributes;
    const moved = new Float32Array(position.array.length);
    for (let i = 0; i < moved.length; ++i) moved[i] = position.array[i] + distance * normal.array[i];
    hull.setAttribute('position', new BufferAttribute(moved, 3));
    hulls.set(geometry, hull);
  }
  return hulls.get(geometry);
}

/** The way of the tool in the last seconds. */
export class Trail {
  #points = new Float32Array(3 * Trail.POINTS);
  #point = new Vector3();

  static POINTS = 80;

  constructor() {
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(this.#points, 3).setUsage(DynamicDrawUsage));
    this.root = new Line(geometry, new LineBasicMaterial({ transparent: true, opacity: 0.8 }));
    this.root.frustumCulled = false;
  }

  /** Draws the way from one time to another; `poseAt` poses the arm, which is left at the last time. */
  show(arm, from, to, poseAt) {
    for (let i = 0; i < Trail.POINTS; ++i) {
      poseAt(from + ((to - from) * i) / (Trail.POINTS - 1));
      arm.toolPosition(this.#point).toArray(this.#points, 3 * i);
    }
    this.root.geometry.attributes.position.needsUpdate = true;
  }

  paint(colour) {
    this.root.material.color = new Color(colour);
  }
}
