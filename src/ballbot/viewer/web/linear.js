// Vectors, quaternions and matrices. A vector is an array of three numbers, a quaternion one of four (w x y z), a matrix
// sixteen numbers in columns, as WebGL takes them.

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const norm = (a) => Math.hypot(a[0], a[1], a[2]);
const unit = (a) => scale(a, 1 / (norm(a) || 1));

/** Return a unit vector at right angles to a vector. */
function acrossTo(a) {
  return unit(cross(a, Math.abs(a[2]) < 0.9 * norm(a) ? [0, 0, 1] : [1, 0, 0]));
}

/** Return the matrix with these columns and this origin. */
function frame(x, y, z, origin) {
  return [...x, 0, ...y, 0, ...z, 0, ...origin, 1];
}

function multiply(a, b) {
  const product = new Array(16).fill(0);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++)
      for (let k = 0; k < 4; k++) product[4 * column + row] += a[4 * k + row] * b[4 * column + k];
  return product;
}

/** Return the point that a matrix makes of a point. */
function transform(m, p) {
  return [0, 1, 2].map((i) => m[i] * p[0] + m[4 + i] * p[1] + m[8 + i] * p[2] + m[12 + i]);
}

/** Return the direction that a matrix makes of a direction. */
function turn(m, d) {
  return [0, 1, 2].map((i) => m[i] * d[0] + m[4 + i] * d[1] + m[8 + i] * d[2]);
}

/** Return the matrix Rx(theta) Ry(phi) Rz(psi), body to world, with an origin. */
function attitude(theta, phi, psi, origin) {
  const [s1, c1, s2, c2] = [Math.sin(theta), Math.cos(theta), Math.sin(phi), Math.cos(phi)];
  const [s3, c3] = [Math.sin(psi), Math.cos(psi)];
  return frame(
    [c2 * c3, c1 * s3 + s1 * s2 * c3, s1 * s3 - c1 * s2 * c3],
    [-c2 * s3, c1 * c3 - s1 * s2 * s3, s1 * c3 + c1 * s2 * s3],
    [s2, -s1 * c2, c1 * c2],
    origin,
  );
}

/** Return the matrix of a quaternion, with an origin; the quaternion need not have the norm 1. */
function ofQuaternion(q, origin) {
  const length = Math.hypot(...q) || 1;
  const [w, x, y, z] = q.map((part) => part / length);
  return frame(
    [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
    [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
    [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
    origin,
  );
}

/** Return the turn about the z axis by an angle. */
function aboutZ(angle) {
  const [s, c] = [Math.sin(angle), Math.cos(angle)];
  return frame([c, s, 0], [-s, c, 0], [0, 0, 1], [0, 0, 0]);
}

/** Return the matrix from the world to the screen's cube, seen from an eye with the axes of its picture. */
function perspective(eye, [right, up, back], fieldOfView, aspect, near, far) {
  const view = [
    right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
    -dot(right, eye), -dot(up, eye), -dot(back, eye), 1,
  ];
  const f = 1 / Math.tan(fieldOfView / 2);
  const depth = 1 / (near - far);
  return multiply([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (near + far) * depth, -1, 0, 0, 2 * near * far * depth, 0], view);
}
