import {
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  CapsuleGeometry,
  Color,
  CylinderGeometry,
  Group,
  Line,
  LineBasicMaterial,
  Mesh,
  MeshStandardMaterial,
  Quaternion,
  SphereGeometry,
  SRGBColorSpace,
  Vector3,
} from 'three';
import { DataError } from './data.js';

/** The shapes of each link, made once for all arms: [geometry, position, orientation]. */
export function readShapes(run) {
  return run.scene.links.map((link, i) =>
    (link.shapes ?? []).map((shape, k) => readShape(run, shape, `scene.links[${i}].shapes[${k}]`)),
  );
}

function readShape(run, shape, where) {
  const { position, orientation } = readPose(shape.pose);
  switch (shape.type) {
    case 'capsule': {
      const from = new Vector3(...shape.from);
      const along = new Vector3(...shape.to).sub(from);
      const geometry = new CapsuleGeometry(shape.radius, along.length(), 8, 24); // along y
      const turn = new Quaternion().setFromUnitVectors(
        new Vector3(0, 1, 0),
        along.lengthSq() > 0 ? along.clone().normalize() : new Vector3(0, 1, 0),
      );
      return { geometry, position: from.addScaledVector(along, 0.5), orientation: turn };
    }
    case 'box':
      return { geometry: new BoxGeometry(...shape.size), position, orientation };
    case 'cylinder': // three's is along y
      return {
        geometry: new CylinderGeometry(shape.radius, shape.radius, shape.length, 32).rotateX(Math.PI / 2),
        position,
        orientation,
      };
    case 'sphere':
      return { geometry: new SphereGeometry(shape.radius, 32, 20), position, orientation };
    case 'mesh': {
      const geometry = new BufferGeometry();
      geometry.setAttribute('position', new BufferAttribute(run.array(shape.positions, `${where}.positions`), 3));
      if (shape.indices)
        geometry.setIndex(new BufferAttribute(Uint32Array.from(run.array(shape.indices, `${where}.indices`)), 1));
      geometry.computeVertexNormals();
      return { geometry, position, orientation };
    }
    default:
      throw new DataError(`${where}: unknown shape ${shape.type}.`);
  }
}

function readPose(pose) {
  const [w, x, y, z] = pose?.quat ?? [1, 0, 0, 0];
  return { position: new Vector3(...(pose?.xyz ?? [0, 0, 0])), orientation: new Quaternion(x, y, z, w) };
}

/** An arm in three's scene: a frame per link, moved by joint angles. */
export class Arm {
  #links;

  /** @param {{translucent: boolean}} look */
  constructor(run, shapes, { translucent }) {
    this.root = new Group();
    this.#links = run.scene.links.map((link, i) => {
      const { position, orientation } = readPose(link.origin);
      const origin = new Group();
      origin.position.copy(position);
      origin.quaternion.copy(orientation);
      const frame = new Group(); // moves in its origin
      origin.add(frame);
      const material = new MeshStandardMaterial({
        roughness: 0.62,
        metalness: 0.05,
        transparent: translucent,
        opacity: translucent ? 0.38 : 1,
        depthWrite: !translucent,
      });
      for (const shape of shapes[i]) {
        const mesh = new Mesh(shape.geometry, material);
        mesh.position.copy(shape.position);
        mesh.quaternion.copy(shape.orientation);
        frame.add(mesh);
      }
      const axis = new Vector3(...(link.axis ?? [0, 0, 1])).normalize();
      return {
        frame,
        origin,
        material,
        base: new Color(),
        axis,
        joint: link.joint,
        linear: run.joints[link.joint]?.linear,
        own: link.color,
      };
    });
    run.scene.links.forEach(({ parent }, i) => {
      (this.#links[parent]?.frame ?? this.root).add(this.#links[i].origin);
    });
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

  /** Tints the links that a joint moves in the colour that `colourOf` the joint gives, if any. */
  tint(colourOf) {
    for (const { material, base, joint } of this.#links) {
      const colour = joint >= 0 ? colourOf(joint) : null;
      material.color.copy(base);
      if (colour) material.color.lerp(new Color(colour), 0.6);
    }
  }

  /** Where the last link, the tool, is. */
  toolPosition(target) {
    this.root.updateMatrixWorld(true);
    return this.#links.at(-1).frame.getWorldPosition(target);
  }
}

/** The way of the tool through all frames, drawn from one frame to another. */
export class Trail {
  constructor(arm, q, frames, joints) {
    const points = new Float32Array(3 * frames);
    const point = new Vector3();
    for (let i = 0; i < frames; ++i) {
      arm.pose(q, i * joints);
      arm.toolPosition(point).toArray(points, 3 * i);
    }
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(points, 3));
    this.line = new Line(geometry, new LineBasicMaterial({ transparent: true, opacity: 0.8 }));
    this.line.frustumCulled = false;
  }

  show(from, to) {
    this.line.geometry.setDrawRange(from, Math.max(0, to - from + 1));
  }

  paint(colour) {
    this.line.material.color = new Color(colour);
  }
}
