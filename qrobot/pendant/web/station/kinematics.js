// Frames of an arm from the rows of its table (modified Denavit-Hartenberg), as qrobot/model has them.
import { THREE } from "nicegui-scene";

const MM = 1000;
export const DEG = 180 / Math.PI;

// Frame j in frame j-1: Rx(alpha) Tx(a) Rz(theta) Tz(d).
export function linkFrame(facts, j, value, into) {
  const [alpha, a, d0, theta0] = facts.dh[j];
  const slides = facts.prismatic[j];
  const theta = theta0 + (slides ? 0 : value);
  const d = d0 + (slides ? value : 0);
  const ca = Math.cos(alpha), sa = Math.sin(alpha), ct = Math.cos(theta), st = Math.sin(theta);
  return into.set(ct, -st, 0, a, ca * st, ca * ct, -sa, -sa * d, sa * st, sa * ct, ca, ca * d, 0, 0, 0, 1);
}

// Pose of the last frame in the base.
export function lastFrame(facts, q) {
  const T = new THREE.Matrix4(), A = new THREE.Matrix4();
  for (let j = 0; j < q.length; j++) T.multiply(linkFrame(facts, j, q[j], A));
  return T;
}

// Tip of the tool in the base, m.
export function tip(facts, q) {
  return new THREE.Vector3(...facts.tip).applyMatrix4(lastFrame(facts, q));
}

// x y z in mm, roll pitch yaw in degrees, of a pose: the numbers of `qrobot teach`.
export function place(T) {
  const m = T.elements; // column-major
  const cosine = Math.hypot(m[0], m[1]);
  const inLine = cosine < 1e-9;
  const roll = inLine ? 0 : Math.atan2(m[1], m[0]);
  const yaw = inLine ? Math.atan2(-m[9], m[5]) : Math.atan2(m[6], m[10]);
  return [m[12] * MM, m[13] * MM, m[14] * MM, roll * DEG, Math.atan2(-m[2], cosine) * DEG, yaw * DEG];
}

// Pose of such numbers.
export function frameOf([x, y, z, roll, pitch, yaw]) {
  const T = new THREE.Matrix4().makeRotationFromEuler(new THREE.Euler(yaw / DEG, pitch / DEG, roll / DEG, "ZYX"));
  return T.setPosition(x / MM, y / MM, z / MM);
}

// A joint's value in the units of people.
export function shown(facts, j, value) {
  return value * (facts.prismatic[j] ? MM : DEG);
}

// A number for people, without the sign of a zero.
export function digits(value, places) {
  return (Math.round(value * 10 ** places) / 10 ** places + 0).toFixed(places);
}

export function unit(facts, j) {
  return facts.prismatic[j] ? "mm" : "°";
}
