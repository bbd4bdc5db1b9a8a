import { Box3, BoxGeometry, BufferGeometry, ConeGeometry, CylinderGeometry, DoubleSide, EdgesGeometry } from 'three';
import { Group, InstancedMesh, Line, LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshBasicMaterial } from 'three';
import { MeshStandardMaterial, PlaneGeometry, SphereGeometry, Vector3 } from 'three';
import { el } from './dom.js';
import { inNewtons, ticks } from './format.js';
import { asOneBody, ORDER, placed, readPose, readShape } from './scene.js';

/** What stands around the arm, in three's scene. */
export class Surroundings {
  #moving = []; // functions of the time
  #endless = new Set(); // objects that go on beyond what is drawn of them
  #fills = [];
  #lines = [];

  /**
   * @param {Object} environment of the data
   * @param {import('three').Sphere} ball about what is looked at: half-spaces are drawn as far as it
   */
  constructor(run, environment, ball) {
    this.root = new Group();
    environment.obstacles.forEach((obstacle, i) => this.root.add(this.#make(run, obstacle, ball, `obstacles[${i}]`)));
    this.show(run.tMin);
  }

  #make(run, obstacle, ball, where) {
    const { type } = obstacle;
    if (type === 'half_space') return this.#makeHalfSpace(obstacle, ball);
    if (type === 'moving_sphere') return this.#makeMovingSphere(obstacle);
    if (type === 'person') return this.#makePerson(run, obstacle, where);
    if (type === 'map') return obstacle.centres ? this.#makeMap(run, obstacle, where) : new Group();
    const shape = readShape(run, obstacle, where);
    const edges = new LineSegments(new EdgesGeometry(shape.geometry, 30));
    return placed(new Group(), shape).add(this.#fill(shape.geometry, 0.42), this.#line(edges, 0.75));
  }

  /** A square of its face, as long as what is looked at and centred on it. */
  #makeHalfSpace({ pose }, { center, radius }) {
    const { position, orientation } = readPose(pose);
    const up = new Vector3(0, 0, 1).applyQuaternion(orientation);
    const group = new Group();
    group.position.copy(center).addScaledVector(up, up.dot(position) - up.dot(center));
    group.quaternion.copy(orientation);
    const geometry = new PlaneGeometry(3 * radius, 3 * radius);
    this.#endless.add(group);
    const face = this.#fill(geometry, 0.16);
    face.material.side = DoubleSide;
    group.add(face, this.#line(new LineSegments(new EdgesGeometry(geometry)), 0.5));
    return group;
  }

  /** The sphere where it is, and its way. */
  #makeMovingSphere({ radius, waypoints, repeats }) {
    const ball = this.#fill(new SphereGeometry(radius, 32, 20), 0.62);
    this.#moving.push((time) => ball.position.copy(positionAt(waypoints, repeats, time)));
    const way = new BufferGeometry().setFromPoints(waypoints.map(([, ...place]) => new Vector3(...place)));
    return new Group().add(ball, this.#line(new Line(way), 0.55));
  }

  /** The person where it is, and pale where it can be when the arm's backup stop has ended. */
  #makePerson(run, { capsules, waypoints, repeats, unseen, ...person }, where) {
    const body = new Group();
    const shells = [];
    capsules.forEach((capsule, i) => {
      const shape = { type: 'capsule', ...capsule };
      const read = readShape(run, shape, `${where}.capsules[${i}]`);
      const mesh = this.#fill(read.geometry, 0.7);
      const shell = new Group();
      const length = new Vector3(...capsule.to).distanceTo(new Vector3(...capsule.from));
      const [ball, rod] = [new SphereGeometry(1, 24, 16), new CylinderGeometry(1, 1, 1, 24, 1, true)];
      const ends = [ball, ball].map((end, k) => {
        const part = this.#fill(end, 0.09);
        part.position.y = (k - 0.5) * length;
        return part;
      });
      const middle = this.#fill(rod, 0.09);
      middle.visible = length > 0;
      shell.add(...ends, middle);
      placed(shell, read);
      body.add(placed(mesh, read));
      const resize = (radius) => {
        for (const end of ends) end.scale.setScalar(radius);
        middle.scale.set(radius, length || 1, radius);
      };
      shells.push({ shell, radius: capsule.radius, resize });
    });
    const reach = new Group().add(...shells.map(({ shell }) => shell));
    this.#moving.push((time, stop_s) => {
      body.position.copy(positionAt(waypoints, repeats, time));
      const absence = unseen.find(([from, to]) => time >= from && time < to);
      const seen = absence ? absence[0] : time;
      reach.position.copy(positionAt(waypoints, repeats, seen - person.latency_s));
      const grown = person.error_m + person.speed_mps * (time - seen + person.latency_s + stop_s);
      for (const { radius, resize } of shells) resize(radius + grown);
    });
    return new Group().add(body, reach);
  }

  /** Cubes, with the arm seen through the foremost of them. */
  #makeMap(run, { pose, edge_m: edge, centres: reference }, where) {
    const centres = run.array(reference, `${where}.centres`);
    const material = new MeshStandardMaterial({ roughness: 0.9, opacity: 0.5 });
    const cubes = placed(new InstancedMesh(new BoxGeometry(edge, edge, edge), material, centres.length / 3), readPose(pose));
    const place = new Matrix4();
    for (let i = 0; i < cubes.count; ++i)
      cubes.setMatrixAt(i, place.setPosition(centres[3 * i], centres[3 * i + 1], centres[3 * i + 2]));
    const [depth, paint] = asOneBody(cubes, ORDER.map);
    depth.instanceMatrix = paint.instanceMatrix;
    this.#fills.push(material);
    return new Group().add(depth, paint);
  }

  #fill(geometry, opacity) {
    const material = new MeshStandardMaterial({ roughness: 0.9, transparent: true, opacity, depthWrite: false });
    this.#fills.push(material);
    const mesh = new Mesh(geometry, material);
    mesh.renderOrder = ORDER.solid;
    return mesh;
  }

  #line(line, opacity) {
    line.material = new LineBasicMaterial({ transparent: true, opacity, depthWrite: false });
    this.#lines.push(line.material);
    line.renderOrder = ORDER.solid;
    return line;
  }

  paint(colour) {
    for (const material of [...this.#fills, ...this.#lines]) material.color.set(colour);
  }

  /** Moves what moves to where it is at a time. @param {number} stop_s how long the arm's backup stop takes then */
  show(time, stop_s = 0) {
    for (const move of this.#moving) move(time, stop_s);
  }

  /** The part of a box [Box3] that obstacles are in that have an end. */
  partOf(box) {
    const part = new Box3();
    for (const child of this.root.children) {
      if (this.#endless.has(child)) continue;
      const own = new Box3().setFromObject(child).intersect(box);
      if (!own.isEmpty()) part.union(own);
    }
    return part;
  }
}

/**
 * The place of a sphere: straight from waypoint to waypoint. It waits at the first; from the last on it stays or begins
 * anew.
 */
function positionAt(waypoints, repeats, time) {
  const [first] = waypoints[0];
  const [last] = waypoints.at(-1);
  const period = last - first;
  const t = repeats && period > 0 && time > last ? first + ((time - first) % period) : time;
  const next = waypoints.findIndex(([at]) => at > t);
  const placeOf = ([, ...place]) => new Vector3(...place);
  if (next < 0) return placeOf(waypoints.at(-1));
  if (next === 0) return placeOf(waypoints[0]);
  const [from, to] = [waypoints[next - 1], waypoints[next]];
  return placeOf(from).lerp(placeOf(to), (t - from[0]) / (to[0] - from[0]));
}

/** Seen through all else, with a label beside it. */
class Mark {
  at = new Vector3(); // of the label

  constructor(stage, geometries) {
    this.label = el('span.nearest-label', { hidden: true });
    stage.append(this.label);
    this.material = new MeshBasicMaterial({ transparent: true, depthTest: false });
    this.parts = geometries.map((geometry) => new Mesh(geometry, this.material));
    for (const part of this.parts) part.renderOrder = ORDER.mark;
    this.root = new Group().add(...this.parts);
  }

  hide() {
    this.root.visible = false;
    this.label.hidden = true;
  }

  paint(colour) {
    this.material.color.set(colour);
  }

  /** Puts the label beside it as the camera sees it; without a text it is hidden. */
  placeLabel(text, camera, width, height) {
    const { x, y, z } = this.at.clone().project(camera);
    this.label.hidden = !this.root.visible || !text || Math.abs(x) > 1 || Math.abs(y) > 1 || z > 1;
    if (this.label.hidden) return;
    this.label.textContent = text;
    this.label.style.setProperty('left', `${((1 + x) / 2) * width}px`);
    this.label.style.setProperty('top', `${((1 - y) / 2) * height}px`);
  }
}

/** A line between the nearest points of arm and obstacle. */
export class NearestLine extends Mark {
  #from = new Vector3();
  #to = new Vector3();

  /** @param {number} size of the arm [m] */
  constructor(stage, size) {
    const dot = new SphereGeometry(0.009 * size, 16, 12);
    super(stage, [dot, dot, new BoxGeometry(1, 1, 1)]);
    this.parts[2].scale.setScalar(0.005 * size);
  }

  /** Puts it between the points of a clearance; hides it where there are none. */
  show(nearest) {
    this.root.visible = Number.isFinite(nearest?.distance);
    if (!this.root.visible) return;
    const [start, end, rod] = this.parts;
    start.position.copy(this.#from.fromArray(nearest.onArm));
    end.position.copy(this.#to.fromArray(nearest.onObstacle));
    rod.position.copy(this.at.addVectors(this.#from, this.#to).multiplyScalar(0.5));
    rod.lookAt(this.#to);
    rod.scale.z = this.#from.distanceTo(this.#to);
  }
}

/** How many newtons a tenth of a metre of an arrow stands for: a round number, so that the largest is a third of the arm. */
export const forceScale = (peak, size) => (peak > 0 ? ticks(0, peak, (10 / 3) * size).increment : 0);

/** What the replay and the page of a live arm say of a touch. */
export const describeContact = ({ pressing, obstacle }) => `presses ${obstacle} with ${inNewtons(pressing)}`;

/** The force of the surroundings on the arm: from where it touches, along the force. */
export class ForceArrow extends Mark {
  #head; // its length [m]

  /** @param {number} size of the arm [m] */
  constructor(stage, size) {
    const rod = new CylinderGeometry(0.005 * size, 0.005 * size, 1, 16).translate(0, 0.5, 0); // along y from the point
    super(stage, [rod, new ConeGeometry(0.015 * size, 1, 24).translate(0, -0.5, 0)]); // up to its tip
    this.#head = 0.045 * size;
    this.root.name = 'force'; // for scripts
  }

  /** @param contact null: hides it @param {number} perDecimetre forceScale() */
  show(contact, perDecimetre) {
    const force = new Vector3(...(contact?.force ?? []));
    const length = (0.1 * force.length()) / perDecimetre;
    this.root.visible = length > 0 && Number.isFinite(length);
    if (!this.root.visible) return;
    const [rod, head] = this.parts;
    this.root.position.fromArray(contact.point);
    this.root.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), force.normalize());
    rod.scale.y = Math.max(1e-9, length - this.#head);
    head.position.y = length;
    const part = Math.min(1, length / this.#head);
    head.scale.set(part, part * this.#head, part);
    this.at.copy(this.root.position).addScaledVector(force, length);
  }
}
