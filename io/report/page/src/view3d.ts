// The 3-D view, built apart from the page (see vite.config.ts): everything of three.js is in here.
// z is up, lengths are in m, everything is placed in the frame of the base link.
import {
  AmbientLight, Box3, BoxGeometry, BufferAttribute, BufferGeometry, Color, CylinderGeometry, DirectionalLight,
  EdgesGeometry, Group, InstancedMesh, LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshLambertMaterial, Object3D,
  PerspectiveCamera, Points, PointsMaterial, Quaternion, Scene as Stage, SphereGeometry, Vector3, WebGLRenderer,
} from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import type { Pose7, Samples, Scene, SceneSensor, SceneTarget } from './data';
import { compose, eigen3, identity, inverse, linkPoses, magnified, quantile, rotate } from './maths';
import type { Theme } from './state';

export interface Options {
  scene: Scene; samples: Samples; colours: Theme; sample: number; choose: (sample: number) => void;
  /** A sensor or target was clicked ("sensor/NAME", "target/NAME"), and a point of the target, or -1. */
  choosePart: (part: string, point: number) => void;
  residuals: (sample: number) => Residual[];
  /** Draws the robot in all samples, thin. */
  postures: boolean;
}
/** The residual of one point in one sensor: predicted minus measured, m or px; of a pose its translation. */
export interface Residual { sensor: string; target: string; id: number; r: number[]; px: boolean }
export type Part = 'postures' | 'before' | 'names' | 'axes' | 'bodies' | 'ellipsoids' | 'arrows';
export interface View3d {
  /** Factors at which the largest difference and the largest uncertainty are well seen, and not larger than the robot. */
  start: { difference: number; uncertainty: number; residuals: number };
  choose(sample: number): void;
  difference(k: number): void;
  uncertainty(k: number): void;
  residuals(k: number): void;
  mark(part: string): void;
  show(part: Part, on: boolean): void;
  paint(colours: Theme): void;
  home(): void;
}

const at = (object: Object3D, pose: Pose7) => {
  object.position.set(pose[0], pose[1], pose[2]);
  object.quaternion.set(pose[3], pose[4], pose[5], pose[6]);
};
function lines(points: number[], material: LineBasicMaterial): LineSegments {
  const geometry = new BufferGeometry();
  geometry.setAttribute('position', new BufferAttribute(Float32Array.from(points), 3));
  return new LineSegments(geometry, material);
}

/** A camera's pyramid, as far as `depth`: corners of its image through its lens (without distortion). */
function frustum(sensor: SceneSensor, depth: number): number[] {
  const [w, h] = sensor.image_size!;
  const [fx, fy, cx, cy] = sensor.intrinsics!;
  const corner = (u: number, v: number) => [((u - cx) / fx) * depth, ((v - cy) / fy) * depth, depth];
  const corners = [corner(0, 0), corner(w, 0), corner(w, h), corner(0, h)];
  const made: number[] = [];
  corners.forEach((c, i) => made.push(0, 0, 0, ...c, ...c, ...corners[(i + 1) % 4]));
  // A tick marks the upper side of the image.
  made.push(...corner(w * 0.45, 0), ...corner(w / 2, -h * 0.12), ...corner(w / 2, -h * 0.12), ...corner(w * 0.55, 0));
  return made;
}
function octahedron(s: number): number[] {
  const tips = [[s, 0, 0], [0, s, 0], [-s, 0, 0], [0, -s, 0]];
  return tips.flatMap((t, i) => [...t, ...tips[(i + 1) % 4], ...t, 0, 0, s, ...t, 0, 0, -s]);
}
/** Points of a target as small crosses, and the frame around them. */
function targetLines(target: SceneTarget, size: number): number[] {
  const points = target.points?.length ? target.points : [[0, 0, 0]];
  const made: number[] = [];
  for (const [x, y, z] of points.length > 400 ? points.slice(0, 400) : points)
    made.push(x - size, y, z, x + size, y, z, x, y - size, z, x, y + size, z);
  if (points.length > 3) {
    const xs = points.map((p) => p[0]), ys = points.map((p) => p[1]);
    const [a, b, c, d] = [Math.min(...xs) - 2 * size, Math.max(...xs) + 2 * size, Math.min(...ys) - 2 * size, Math.max(...ys) + 2 * size];
    made.push(a, c, 0, b, c, 0, b, c, 0, b, d, 0, b, d, 0, a, d, 0, a, d, 0, a, c, 0);
  }
  return made;
}
/** Links that carry a sensor or a target, and all above them. Others are drawn thin. */
function chainLinks(scene: Scene): Set<number> {
  const kept = new Set<number>();
  for (const s of [...scene.sensors, ...scene.targets])
    for (let i = s.link; i >= 0 && !kept.has(i); i = scene.links[i].parent) kept.add(i);
  return kept;
}

const distance = (a: Pose7, b: Pose7) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
interface Body { after: Pose7; before: Pose7; open?: boolean }

/** The pose of everything at a sample's readings. Without a sample: the first one. */
function poses(options: Options, sample: number) {
  const { scene, samples } = options;
  const at = sample >= 0 ? sample : 0;
  const position = (joint: string) => samples.joints?.[joint]?.[at] ?? 0;
  const after = linkPoses(scene.links, scene.base, position, 'after');
  const before = linkPoses(scene.links, scene.base, position, 'before');
  const mounted = (s: { link: number; before: Pose7 | null; after: Pose7 | null }): Body | null => {
    if (s.link < 0 || !s.after) return null;
    const b = compose(before[s.link], s.before ?? s.after);
    return { after: compose(after[s.link], s.after), before: b, open: !s.before };     // open: the rig gives no pose
  };
  return {
    links: after.map((pose, i): Body => ({ after: pose, before: before[i] })),
    sensors: scene.sensors.map(mounted),
    targets: scene.targets.map((t): Body | null => {
      if (t.link >= 0) return mounted(t);
      const pose = samples.targets?.[t.name]?.[at];
      return pose ? { after: pose, before: pose } : null;
    }),
  };
}

/** Where a point of a target is, and from there the way to where the sensor saw it: minus the residual. Pixels become
 *  lengths across at the point's distance; of a tilting laser it is the part along the ray, for each ray has its own tilt. */
function arrowOf(options: Options, of: ReturnType<typeof poses>, given: Residual): { at: number[]; way: number[] } | null {
  const s = options.scene.sensors.findIndex((one) => one.name === given.sensor);
  const t = options.scene.targets.findIndex((one) => one.name === given.target);
  const target = of.targets[t]?.after, sensor = of.sensors[s]?.after;
  if (!target) return null;
  const point = given.id >= 0 ? options.scene.targets[t].points?.[given.id] : [0, 0, 0];
  if (!point) return null;
  const at = compose(target, [...point, 0, 0, 0, 1]).slice(0, 3);
  if (given.id < 0) return { at, way: rotate(target.slice(3), given.r.map((v) => -v)) };
  if (!sensor) return null;
  const seen = compose(inverse(sensor), [...at, 0, 0, 0, 1]);
  const { intrinsics, type } = options.scene.sensors[s];
  if (given.px) {
    if (!intrinsics) return null;
    return { at, way: rotate(sensor.slice(3), [-given.r[0] / intrinsics[0] * seen[2], -given.r[1] / intrinsics[1] * seen[2], 0]) };
  }
  if (type !== 'tilting_laser') return { at, way: rotate(sensor.slice(3), given.r.map((v) => -v)) };
  const ray = [0, 1, 2].map((i) => at[i] - sensor[i]), far = Math.hypot(...ray) || 1;
  const along = Math.hypot(...given.r) * Math.sign(given.r[0] || 1);
  return { at, way: ray.map((v) => (-v / far) * along) };
}

export function create(host: HTMLElement, options: Options): View3d {
  const { scene } = options;
  const renderer = new WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  renderer.setPixelRatio(Math.min(2, devicePixelRatio || 1));
  const canvas = renderer.domElement;
  canvas.tabIndex = 0;
  canvas.setAttribute('aria-label', 'The robot in three dimensions. Arrow keys turn it, plus and minus zoom.');
  host.append(canvas);
  const stage = new Stage();
  stage.add(new AmbientLight(0xffffff, 1.6));
  const light = new DirectionalLight(0xffffff, 1.8);
  light.position.set(2, -3, 5);
  stage.add(light);
  const camera = new PerspectiveCamera(40, 1, 0.005, 200);
  camera.up.set(0, 0, 1);
  const controls = new OrbitControls(camera, canvas);
  let asked = 0;
  const renderNow = () => { renderer.render(stage, camera); placeNames(); };
  const render = () => { asked ||= requestAnimationFrame(() => { asked = 0; renderNow(); }); };
  controls.addEventListener('change', render);

  const materials = {
    bone: new MeshLambertMaterial(), thin: new LineBasicMaterial(), sensor: new LineBasicMaterial(), target: new LineBasicMaterial(),
    before: new LineBasicMaterial(), ghost: new MeshLambertMaterial({ transparent: true, opacity: 0.45, depthWrite: false }),
    ellipsoid: new MeshLambertMaterial({ transparent: true, opacity: 0.4, depthWrite: false }),
    body: new LineBasicMaterial({ transparent: true, opacity: 0.5 }),
    dots: new PointsMaterial({ size: 4, sizeAttenuation: false }), chosen: new PointsMaterial({ size: 10, sizeAttenuation: false, depthTest: false }),
    posture: new LineBasicMaterial({ transparent: true, opacity: 0.5 }), marked: new LineBasicMaterial(), arrow: new LineBasicMaterial({ depthTest: false }),
  };
  const world = { links: new Group(), before: new Group(), axes: new Group(), bodies: new Group(), ellipsoids: new Group(), dots: new Group(), arrows: new Group(), postures: new Group() };
  stage.add(...Object.values(world));
  world.axes.visible = false;

  let sample = options.sample, k = 10, sigmas = 30, times = 1, reach = 1, marked = '';
  /** Things that can be clicked: dots of samples, sensors, points of targets. */
  let found: { at: Vector3; sample?: number; part?: string; point?: number }[] = [];
  const kept = chainLinks(scene);
  const clear = (group: Group) => {
    for (const child of [...group.children]) {
      group.remove(child);
      (child as Mesh).geometry?.dispose();
    }
  };
  /** Bones of the links that matter as rods, of the others as thin lines. */
  const bones = (bodies: Body[], pick: (body: Body) => Pose7, material: MeshLambertMaterial, group: Group, thin: LineBasicMaterial | null) => {
    const radius = reach * 0.006;
    const rods: Matrix4[] = [], rest: number[] = [];
    const up = new Vector3(0, 1, 0);
    scene.links.forEach((link, i) => {
      const parent = above(i);
      if (parent < 0 || link.between_axes) return;
      const a = new Vector3(...(pick(bodies[parent]).slice(0, 3) as [number, number, number]));
      const b = new Vector3(...(pick(bodies[i]).slice(0, 3) as [number, number, number]));
      const d = b.clone().sub(a);
      const length = d.length();
      if (length < 1e-4) return;
      if (!thin && distance(pick(bodies[i]), bodies[i].after) < radius / 2 && distance(pick(bodies[parent]), bodies[parent].after) < radius / 2)
        return;                                            // a ghost that lies in its bone would only stain it
      if (!kept.has(i)) { rest.push(...a.toArray(), ...b.toArray()); return; }
      rods.push(new Matrix4().compose(a.add(b).multiplyScalar(0.5), new Quaternion().setFromUnitVectors(up, d.normalize()), new Vector3(radius, length, radius)));
    });
    const mesh = new InstancedMesh(new CylinderGeometry(1, 1, 1, 10), material, Math.max(1, rods.length));
    mesh.count = rods.length;
    rods.forEach((m, i) => mesh.setMatrixAt(i, m));
    mesh.frustumCulled = false;
    group.add(mesh);
    if (thin && rest.length) group.add(lines(rest, thin));
  };
  const axes = (pose: Pose7, size: number) => {
    const tripod = new Group();
    // Okabe and Ito's vermilion, green and blue for x, y and z.
    [[1, 0, 0, 0xd55e00], [0, 1, 0, 0x009e73], [0, 0, 1, 0x0072b2]].forEach(([x, y, z, colour]) =>
      tripod.add(lines([0, 0, 0, x * size, y * size, z * size], new LineBasicMaterial({ color: colour }))));
    at(tripod, pose);
    return tripod;
  };
  // Names are elements over the picture, so that they stay sharp and are text. Those that would lie on each other are
  // moved down, the nearest to the top first.
  let names: { element: HTMLElement; at: Vector3 }[] = [];
  let named = true;
  const addName = (text: string, pose: Pose7) => {
    const element = document.createElement('span');
    element.className = 'name3d';
    element.textContent = text;
    host.append(element);
    names.push({ element, at: new Vector3(pose[0], pose[1], pose[2]) });
  };
  function placeNames(): void {
    const w = host.clientWidth, hgt = host.clientHeight, row = 15;
    const seen = names.map(({ element, at }) => ({ element, p: at.clone().project(camera) }))
      .map(({ element, p }) => ({ element, x: ((p.x + 1) / 2) * w + 6, y: ((1 - p.y) / 2) * hgt - 6, there: named && p.z < 1 && Math.abs(p.x) < 1 && Math.abs(p.y) < 1 }))
      .sort((a, b) => a.y - b.y);
    const placed: { x: number; y: number; width: number }[] = [];
    for (const { element, x, y, there } of seen) {
      element.hidden = !there;
      if (!there) continue;
      const width = Math.min(320, (element.textContent?.length ?? 0) * 7);
      let at = y;
      for (const other of placed) if (x < other.x + other.width && other.x < x + width && Math.abs(at - other.y) < row) at = other.y + row;
      placed.push({ x, y: at, width });
      placed.sort((a, b) => a.y - b.y);
      element.style.transform = `translate(${Math.round(x)}px, ${Math.round(at)}px)`;
    }
  }

  function build(): void {
    for (const group of Object.values(world)) clear(group);
    for (const { element } of names) element.remove();
    names = [];
    found = [];
    const p = poses(options, sample);
    const size = reach * 0.05;
    bones(p.links, (b) => b.after, materials.bone, world.links, materials.thin);
    bones(p.links, (b) => magnified(b.after, b.before, k), materials.ghost, world.before, null);
    const seats = new Map<string, string[]>();              // names at the same place are in one line
    const seat = (text: string, pose: Pose7) => {
      const key = pose.slice(0, 3).map((v) => Math.round(v / (reach * 0.02))).join();
      seats.set(key, [...(seats.get(key) ?? []), text]);
      if (seats.get(key)!.length === 1) places.push({ key, pose });
    };
    const places: { key: string; pose: Pose7 }[] = [];
    seat(scene.links[scene.base]?.name ?? 'base', identity);
    world.axes.add(axes(identity, size * 2));
    scene.sensors.forEach((sensor, i) => {
      const body = p.sensors[i];
      if (!body) return;
      const camera = sensor.image_size && sensor.intrinsics?.length === 4;
      const drawn = camera ? frustum(sensor, size * 1.6) : octahedron(size * 0.4);
      const part = `sensor/${sensor.name}`;
      found.push({ at: new Vector3(...(body.after.slice(0, 3) as [number, number, number])), part });
      const solid = lines(drawn, part === marked ? materials.marked : materials.sensor), ghost = lines(drawn, materials.before);
      at(solid, body.after);
      at(ghost, magnified(body.after, body.before, k));
      world.links.add(solid);
      if (!body.open) world.before.add(ghost);
      world.axes.add(axes(body.after, size));
      seat(sensor.name, body.after);
      ellipsoid(sensor.covariance, body.after);
    });
    scene.targets.forEach((target, i) => {
      const body = p.targets[i];
      if (!body) return;
      const drawn = targetLines(target, reach * 0.003);
      const part = `target/${target.name}`;
      const solid = lines(drawn, part === marked ? materials.marked : materials.target);
      (target.points?.length ? target.points.slice(0, 400) : [[0, 0, 0]]).forEach((point, id) =>
        found.push({ at: new Vector3(...(compose(body.after, [...point, 0, 0, 0, 1]).slice(0, 3) as [number, number, number])), part, point: id }));
      at(solid, body.after);
      world.links.add(solid);
      if (target.link >= 0 && !body.open) {
        const ghost = lines(drawn, materials.before);
        at(ghost, magnified(body.after, body.before, k));
        world.before.add(ghost);
      }
      world.axes.add(axes(body.after, size));
      seat(target.name, body.after);
      ellipsoid(target.covariance, body.after);
    });
    for (const { key, pose } of places) addName(seats.get(key)!.join(', '), pose);
    scene.links.forEach((link, i) => (link.boxes ?? []).forEach((box) => {
      const drawn = new LineSegments(new EdgesGeometry(new BoxGeometry(...(box.size as [number, number, number]))), materials.body);
      at(drawn, compose(p.links[i].after, box.pose));
      world.bodies.add(drawn);
    }));
    dots();
    arrows(p);
    postures(p);
    render();
  }
  /** The link above that is drawn: not those between the axes of an opened joint. */
  function above(i: number): number {
    let parent = scene.links[i].parent;
    while (parent >= 0 && scene.links[parent].between_axes) parent = scene.links[parent].parent;
    return parent;
  }
  /** Thin lines along the robot in all other samples, out to its sensors and targets; a click there chooses the sample. */
  function postures(now: ReturnType<typeof poses>): void {
    if (!options.postures) return;
    const made: number[] = [];
    const add = (a: Pose7, b: Pose7) => made.push(...a.slice(0, 3), ...b.slice(0, 3));
    for (let s = 0; s < options.samples.id.length; s++) {
      if (s === Math.max(0, sample)) continue;
      const p = poses(options, s);
      scene.links.forEach((link, i) => {
        if (kept.has(i) && !link.between_axes && above(i) >= 0) add(p.links[above(i)].after, p.links[i].after);
      });
      const ends = (all: (Body | null)[], these: (Body | null)[], links: number[]) => all.forEach((body, i) => {
        if (!body || !these[i] || distance(body.after, these[i].after) < 1e-3) return;
        if (links[i] >= 0) add(p.links[links[i]].after, body.after);
        found.push({ at: new Vector3(...(body.after.slice(0, 3) as [number, number, number])), sample: s });
      });
      ends(p.sensors, now.sensors, scene.sensors.map((one) => one.link));
      ends(p.targets, now.targets, scene.targets.map((one) => one.link));
    }
    if (made.length) world.postures.add(lines(made, materials.posture));
  }
  /** From each point of the chosen sample towards where each sensor saw it, magnified. */
  function arrows(p: ReturnType<typeof poses>): void {
    if (sample < 0) return;
    const made: number[] = [];
    for (const given of options.residuals(sample)) {
      const arrow = arrowOf(options, p, given);
      if (!arrow || !arrow.way.every(Number.isFinite)) continue;
      const a = new Vector3(...(arrow.at as [number, number, number]));
      const way = new Vector3(...(arrow.way as [number, number, number])).multiplyScalar(times);
      const b = a.clone().add(way), across = way.clone().cross(new Vector3(0.3, 0.5, 0.8)).setLength(way.length() * 0.12);
      made.push(...a.toArray(), ...b.toArray());
      for (const side of [-1, 1]) made.push(...b.toArray(), ...b.clone().addScaledVector(way, -0.25).addScaledVector(across, side).toArray());
    }
    if (made.length) world.arrows.add(lines(made, materials.arrow));
  }
  function ellipsoid(covariance: number[] | undefined, pose: Pose7): void {
    if (!covariance || covariance.some((v) => !Number.isFinite(v))) return;
    const { values, vectors } = eigen3(covariance);
    const radii = values.map((v) => Math.max(1e-7, sigmas * Math.sqrt(Math.max(0, v))));
    const mesh = new Mesh(new SphereGeometry(1, 24, 16), materials.ellipsoid);
    mesh.matrixAutoUpdate = false;
    const columns = vectors.map((v, i) => new Vector3(...(v as [number, number, number])).multiplyScalar(radii[i]));
    mesh.matrix.makeBasis(columns[0], columns[1], columns[2]).setPosition(pose[0], pose[1], pose[2]);
    world.ellipsoids.add(mesh);
  }
  /** Where free targets were in all samples; each point has its sample. */
  function dots(): void {
    const all: number[] = [], chosen: number[] = [];
    for (const given of Object.values(options.samples.targets ?? {}))
      given.forEach((pose, s) => {
        if (!pose) return;
        all.push(pose[0], pose[1], pose[2]);
        if (s !== sample) found.push({ at: new Vector3(pose[0], pose[1], pose[2]), sample: s });
        if (s === sample) chosen.push(pose[0], pose[1], pose[2]);
      });
    for (const [places, material] of [[all, materials.dots], [chosen, materials.chosen]] as const) {
      if (!places.length) continue;
      const geometry = new BufferGeometry();
      geometry.setAttribute('position', new BufferAttribute(Float32Array.from(places), 3));
      world.dots.add(new Points(geometry, material));
    }
  }
  function paint(colours: Theme): void {
    stage.background = new Color(colours.panel);
    materials.bone.color.set(colours.faint);
    materials.thin.color.set(colours.line);
    materials.posture.color.set(colours.after);
    materials.sensor.color.set(colours.after);
    materials.target.color.set(colours.good);
    materials.before.color.set(colours.before);
    materials.ghost.color.set(colours.before);
    materials.ellipsoid.color.set(colours.other);
    materials.body.color.set(colours.faint);
    materials.dots.color.set(colours.good);
    for (const material of [materials.chosen, materials.marked, materials.arrow]) material.color.set(colours.chosen);
    build();
    resize();
    renderNow();                                           // on paper no frame of the screen comes before it is printed
  }
  /** Places of what matters: chains, sensors, targets at the chosen sample unless they are far from the robot. */
  function places3d(): Vector3[] {
    const p = poses(options, sample);
    const vector = (body: Body) => new Vector3(body.after[0], body.after[1], body.after[2]);
    const corners = scene.links.flatMap((link, i) => (link.boxes ?? []).flatMap((box) => [0, 1, 2, 3, 4, 5, 6, 7].map((c) =>
      compose(compose(p.links[i].after, box.pose), [...box.size.map((s, k) => ((c >> k) & 1 ? s : -s) / 2), 0, 0, 0, 1]))));
    const others = options.postures ? options.samples.id.map((_, s) => poses(options, s)) : [];
    const robot = [...[...p.links.filter((_, i) => kept.has(i)), ...p.sensors].flatMap((body) => (body ? [vector(body)] : [])),
      ...others.flatMap((o) => [...o.links.filter((_, i) => kept.has(i)), ...o.sensors, ...o.targets.filter((_, i) => scene.targets[i].link >= 0)].flatMap((body) => (body ? [vector(body)] : []))),
      ...corners.map(([x, y, z]) => new Vector3(x, y, z))];
    const box = new Box3().setFromPoints(robot);
    const size = box.getSize(new Vector3()).length();
    return [...robot, ...p.targets.flatMap((body, i) => (body && box.distanceToPoint(vector(body)) < size
      ? (scene.targets[i].points ?? [[0, 0, 0]]).map((point) => new Vector3(...(compose(body.after, [...point, 0, 0, 0, 1]).slice(0, 3) as [number, number, number]))) : []))];
  }
  /** The camera from the front right, as near as everything is within the picture: at distance D from the centre a point
   *  with z towards the camera, x and y across is seen if |x| <= (D - z) tan(half angle across), and so for y. */
  function home(): void {
    const all = places3d();
    const box = new Box3().setFromPoints(all);
    const centre = box.getCenter(new Vector3());
    const radius = Math.max(0.1, box.getSize(new Vector3()).length() / 2);
    const towards = new Vector3(1.5, -1.7, 0.9).normalize();
    const across = new Vector3(0, 0, 1).cross(towards).normalize(), up = towards.clone().cross(across);
    const tall = Math.tan((camera.fov * Math.PI) / 360), wide = tall * camera.aspect;
    const distance = Math.max(...all.map((point) => {
      const d = point.clone().sub(centre);
      return d.dot(towards) + Math.max(Math.abs(d.dot(across)) / wide, Math.abs(d.dot(up)) / tall);
    }), radius);
    controls.target.copy(centre);
    camera.near = radius / 100;
    camera.far = radius * 100;
    camera.updateProjectionMatrix();
    camera.position.copy(centre).addScaledVector(towards, distance * 1.15 + 0.05 * radius);
    controls.update();
    render();
  }
  const resize = () => {
    const width = host.clientWidth || 600, height = host.clientHeight || 480;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    render();
  };
  new ResizeObserver(resize).observe(host);

  // A click (not a drag) chooses what is nearest on the screen: a dot its sample, else a sensor or a target's point.
  let down = [0, 0];
  canvas.addEventListener('pointerdown', (event) => { down = [event.clientX, event.clientY]; });
  canvas.addEventListener('click', (event) => {
    if (Math.hypot(event.clientX - down[0], event.clientY - down[1]) > 4) return;
    const box = canvas.getBoundingClientRect();
    let best: (typeof found)[0] | undefined, least = 14;
    for (const one of found) {
      const p = one.at.clone().project(camera);
      const away = Math.hypot(((p.x + 1) / 2) * box.width + box.left - event.clientX, ((1 - p.y) / 2) * box.height + box.top - event.clientY);
      if (p.z < 1 && away < least) { best = one; least = away; }
    }
    if (best?.sample !== undefined) options.choose(best.sample);
    else if (best?.part) options.choosePart(best.part, best.point ?? -1);
  });
  canvas.addEventListener('keydown', (event) => {
    const turns: Record<string, [number, number, number]> = {
      ArrowLeft: [-0.1, 0, 1], ArrowRight: [0.1, 0, 1], ArrowUp: [0, -0.1, 1], ArrowDown: [0, 0.1, 1], '+': [0, 0, 0.9], '-': [0, 0, 1.11],
    };
    const turn = turns[event.key];
    if (!turn) return;
    event.preventDefault();
    event.stopPropagation();
    const offset = camera.position.clone().sub(controls.target);
    const radius = offset.length() * turn[2];
    const azimuth = Math.atan2(offset.y, offset.x) + turn[0];
    const polar = Math.min(3.1, Math.max(0.05, Math.acos(offset.z / offset.length()) + turn[1]));
    camera.position.copy(controls.target).add(new Vector3(Math.sin(polar) * Math.cos(azimuth), Math.sin(polar) * Math.sin(azimuth), Math.cos(polar)).multiplyScalar(radius));
    controls.update();
  });
  canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
  canvas.addEventListener('webglcontextrestored', render);

  reach = Math.max(0.1, new Box3().setFromPoints(places3d()).getSize(new Vector3()).length());
  const most = (values: number[]) => Math.max(1e-9, ...values.filter(Number.isFinite));
  const now = poses(options, sample);
  const moved = most([...now.sensors, ...now.targets, ...now.links.filter((_, i) => kept.has(i))].map((b) => (b ? distance(b.after, b.before) : 0)));
  const sigma = most([...scene.sensors, ...scene.targets].map((s) => (s.covariance ? Math.sqrt(Math.max(0, eigen3(s.covariance).values[0])) : 0)));
  const factor = (size: number, share: number, limit: number) => Math.min(limit, Math.max(1, Math.round((share * reach) / size)));
  // Arrows are well seen if the larger ones of a few samples are a thirtieth of the robot.
  const count = options.samples.id.length;
  const lengths = [...new Set([0, 0.3, 0.6, 0.9].map((share) => Math.floor(share * count)))].flatMap((s) => {
    const of = poses(options, s);
    return options.residuals(s).flatMap((given) => { const arrow = arrowOf(options, of, given); return arrow ? [Math.hypot(...arrow.way)] : []; });
  });
  times = factor(Math.max(1e-9, quantile(lengths.filter(Number.isFinite), 0.9) || 1e-9), 0.03, 10000);
  const start = { residuals: times, difference: factor(moved, 0.1, 100), uncertainty: factor(sigma, 0.05, 1000) };
  k = start.difference;
  sigmas = start.uncertainty;
  paint(options.colours);
  home();
  return {
    start,
    choose: (s) => { sample = s; build(); },
    difference: (value) => { k = value; build(); },
    residuals: (value) => { times = value; build(); },
    mark: (part) => { marked = part; build(); },
    uncertainty: (value) => { sigmas = value; build(); },
    show: (part, on) => { if (part === 'names') named = on; else world[part].visible = on; render(); },
    paint, home,
  };
}
