import { Box3, DirectionalLight, GridHelper, HemisphereLight, PerspectiveCamera, Scene, Sphere, Vector3, WebGLRenderer } from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import { colours } from './theme.js';

const FIELD_OF_VIEW = 35;

/** A picture of an arm in 3D: scene, light, camera and floor. Its heir has `ask()`, which has it drawn soon. */
export class Picture {
  constructor(stage, run, label, antialias = true) {
    this.stage = stage;
    this.run = run;
    this.renderer = new WebGLRenderer({ antialias, alpha: true });
    const canvas = this.renderer.domElement;
    canvas.setAttribute('role', 'img');
    canvas.setAttribute('aria-label', label);
    stage.append(canvas);
    this.scene = new Scene();
    this.scene.add(new HemisphereLight(0xffffff, 0x8892a0, 2.1));
    this.sun = new DirectionalLight(0xffffff, 1.9);
    this.scene.add(this.sun, this.sun.target);
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.01, 100);
    this.camera.up.set(0, 0, 1);
    this.orbit = new OrbitControls(this.camera, canvas);
    this.orbit.addEventListener('change', () => this.ask());
  }

  /** How long the arm is, about [m]. */
  get size() {
    return this.run.scene.links.reduce((sum, { origin }) => sum + Math.hypot(...origin.xyz), 0) || 1;
  }

  /** Takes the ball that holds an arm in all poses that `pose` makes, one after the other; returns the box. */
  bound({ root }, poses = [() => {}]) {
    const box = new Box3().expandByPoint(new Vector3());
    for (const pose of poses) {
      pose();
      root.updateMatrixWorld(true);
      box.expandByObject(root);
    }
    this.ground = box.min.z;
    this.bounds = box.getBoundingSphere(new Sphere());
    if (!(this.bounds.radius > 0)) this.bounds.radius = 1;
    return box;
  }

  /** Looks at all of it from a direction; `fill`: how much of its radius is seen. */
  lookFrom(direction, fill) {
    const { center, radius } = this.bounds;
    this.orbit.target.copy(center);
    const distance = (radius * fill) / Math.sin(((FIELD_OF_VIEW / 2) * Math.PI) / 180);
    this.camera.position.set(...direction).normalize().multiplyScalar(distance).add(center);
    this.camera.near = distance / 100;
    this.camera.far = distance * 20;
    this.camera.updateProjectionMatrix();
    this.sun.position.set(1, -0.6, 1.6).multiplyScalar(radius * 3).add(center);
    this.sun.target.position.copy(center);
    this.orbit.update();
    this.ask();
  }

  paintFloor() {
    if (this.floor) this.scene.remove(this.floor);
    const cell = 10 ** Math.floor(Math.log10(this.bounds.radius * 0.5));
    const cells = 2 * Math.ceil((this.bounds.radius * 1.5) / cell);
    this.floor = new GridHelper(cells * cell, cells, colours.limit, colours.line);
    this.floor.rotation.x = Math.PI / 2;
    this.floor.position.z = Math.min(0, this.ground) - cell * 0.01; // not in the plane that a base may stand on
    this.scene.add(this.floor);
    this.ask();
  }

  /** Takes the size of the stage; false where there is none. */
  fit() {
    const { clientWidth: width, clientHeight: height } = this.stage;
    if (width === 0 || height === 0) return false;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    return true;
  }

  /** Puts the label of a mark beside it. */
  label(mark, text) {
    mark?.placeLabel(text, this.camera, this.stage.clientWidth, this.stage.clientHeight);
  }
}
