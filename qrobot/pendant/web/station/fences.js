// Fences of an arm: the bodies it keeps out of, or inside which it stays, and the part of it that is nearest to one.
import { THREE } from "nicegui-scene";
import { linkFrame } from "./kinematics.js";

const MM = 1000;
const OUT = 0xb3541e, IN = 0x1d7a45, NEAR = 0xe0a100, ENTERED = 0xb3261e;
const PLANE = 2.4; // m, edge of the part of a plane that is drawn
const POINTS = 33; // of the axis of a capsule that are looked at
const CLOSE = 0.1; // m, from which on a part is shown

// Signed distance of a point, in the frame of a fence, from its body.
function outside(fence, p) {
  const [sx, sy, sz] = fence.size;
  if (fence.shape === "plane") return p.z;
  const box = fence.shape === "box";
  const x = box ? Math.abs(p.x) - sx / 2 : Math.hypot(p.x, p.y) - sx;
  const y = box ? Math.abs(p.y) - sy / 2 : -Infinity;
  const z = Math.abs(p.z) - sz / 2;
  return Math.hypot(Math.max(x, 0), Math.max(y, 0), Math.max(z, 0)) + Math.min(Math.max(x, y, z), 0);
}

// Both ends of the axis of each capsule in the base frame, at some joint positions.
function axes(facts, q) {
  const frames = [new THREE.Matrix4()];
  for (let j = 0; j < q.length; j++) frames.push(frames[j].clone().multiply(linkFrame(facts, j, q[j], new THREE.Matrix4())));
  return facts.capsules.map((capsule) => {
    const at = (end) => new THREE.Vector3(...end).applyMatrix4(frames[capsule.link]);
    return [at(capsule.from_m), at(capsule.to_m)];
  });
}

function ofFence(facts, fence, all) {
  const into = new THREE.Matrix4().set(...fence.T).invert(), p = new THREE.Vector3();
  const best = { fence: fence.name, capsule: -1, distance: Infinity, margin: fence.margin };
  facts.capsules.forEach((capsule, i) => {
    const tool = capsule.link === facts.joints.length;
    if (capsule.link === 0 || (fence.bodies !== "all" && (fence.bodies === "tool") !== tool)) return;
    const [a, b] = all[i].map((end) => end.clone().applyMatrix4(into));
    let least = Infinity, most = -Infinity;
    for (let k = 0; k < POINTS; k++) {
      const each = outside(fence, p.lerpVectors(a, b, k / (POINTS - 1)));
      least = Math.min(least, each);
      most = Math.max(most, each);
    }
    const distance = (fence.keep === "in" ? -most : least) - capsule.radius_m;
    if (distance < best.distance) Object.assign(best, { capsule: i, distance });
  });
  return best;
}

// Least distance of two axes (Ericson, Real-Time Collision Detection, 5.1.9).
function apart([a, b], [c, d]) {
  const u = b.clone().sub(a), v = d.clone().sub(c), r = a.clone().sub(c);
  const uu = u.dot(u) || 1e-18, vv = v.dot(v) || 1e-18, uv = u.dot(v), ur = u.dot(r), vr = v.dot(r);
  const share = (value) => Math.min(Math.max(value, 0), 1);
  const crossing = uu * vv - uv * uv;
  let s = crossing > 1e-12 * uu * vv ? share((uv * vr - ur * vv) / crossing) : 0;
  const t = share((uv * s + vr) / vv);
  s = share((uv * t - ur) / uu);
  return r.addScaledVector(u, s).addScaledVector(v, -t).length();
}

function ofItself(facts, all) {
  const best = { fence: "itself", capsule: -1, distance: Infinity, margin: facts.self_margin };
  for (const [i, j] of facts.pairs) {
    const distance = apart(all[i], all[j]) - facts.capsules[i].radius_m - facts.capsules[j].radius_m;
    if (distance < best.distance) Object.assign(best, { capsule: j, distance });
  }
  return best;
}

// The arm and each fence, that which comes next to stop it first.
export function nearness(facts, q) {
  const all = axes(facts, q);
  const found = facts.fences.map((fence) => ofFence(facts, fence, all));
  if (facts.pairs.length) found.push(ofItself(facts, all));
  return found.filter((near) => near.capsule >= 0).sort((a, b) => a.distance - a.margin - (b.distance - b.margin));
}

// What people are told of the first of them; "" for an arm without fences.
export function told(facts, [near]) {
  if (!near) return "";
  const part = facts.capsules[near.capsule].name.replaceAll("_", " ");
  const what = near.fence === "itself" ? "another part of the arm" : `fence ${near.fence}`;
  if (near.distance < 0) return `⚠ ${part} is ${(-near.distance * MM).toFixed(0)} mm past ${what}`;
  const mark = near.distance < near.margin ? "⚠ within the margin: " : "";
  return `${mark}${part} ${(near.distance * MM).toFixed(0)} mm off ${what}`;
}

function body(fence) {
  const [x, y, z] = fence.size;
  if (fence.shape === "plane") return new THREE.PlaneGeometry(PLANE, PLANE);
  if (fence.shape === "box") return new THREE.BoxGeometry(x, y, z);
  return new THREE.CylinderGeometry(x, x, z, fence.keep === "in" ? 12 : 36).rotateX(Math.PI / 2);
}

// A body to keep out of is of glass; one to stay in is a cage, through which the arm is seen.
function figure(fence) {
  const holder = new THREE.Group();
  holder.matrixAutoUpdate = false;
  holder.matrix.set(...fence.T);
  const color = fence.keep === "in" ? IN : OUT, geometry = body(fence);
  const side = fence.shape === "plane" ? THREE.DoubleSide : THREE.FrontSide;
  const glass = { color, side, transparent: true, opacity: 0.3, depthWrite: false };
  if (fence.keep === "out") holder.add(new THREE.Mesh(geometry, new THREE.MeshBasicMaterial(glass)));
  holder.add(new THREE.LineSegments(new THREE.EdgesGeometry(geometry, 20), new THREE.LineBasicMaterial({ color })));
  return holder;
}

function rod(capsule) {
  const a = new THREE.Vector3(...capsule.from_m), b = new THREE.Vector3(...capsule.to_m);
  const geometry = new THREE.CapsuleGeometry(capsule.radius_m, a.distanceTo(b), 8, 20);
  const mesh = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ color: NEAR, transparent: true, opacity: 0.45, depthWrite: false }));
  mesh.position.copy(a).lerp(b, 0.5);
  if (a.distanceTo(b) > 1e-9) mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), b.sub(a).normalize());
  mesh.visible = false;
  return mesh;
}

// The fences of one arm, in its base frame, and the parts of it that are close to one, fixed to their frames.
export class FenceFigures {
  constructor(facts, root, frames) {
    this.facts = facts;
    this.told = "";
    for (const fence of facts.fences) root.add(figure(fence));
    this.rods = facts.capsules.map((capsule) => {
      const mesh = rod(capsule);
      frames[capsule.link].add(mesh);
      return mesh;
    });
  }

  nearness(q) {
    return nearness(this.facts, q);
  }

  // Shown with each picture rather than with each sample, of which there are more.
  show(q) {
    const found = this.nearness(q);
    for (const mesh of this.rods) mesh.visible = false;
    for (const near of found.filter((each) => each.distance < Math.max(CLOSE, each.margin))) {
      const mesh = this.rods[near.capsule];
      const color = near.distance < near.margin ? ENTERED : NEAR;
      if (!mesh.visible) mesh.material.color.setHex(color); // the first is the one that matters most
      mesh.visible = true;
    }
    this.told = told(this.facts, found);
  }
}
