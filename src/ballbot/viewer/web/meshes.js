// Meshes of triangles: nine numbers for each corner: position [m], normal, color (red, green, blue from 0 to 1).

/** A mesh that grows part by part. */
class Mesh {
  constructor() {
    this.corners = [];
    this.indices = [];
  }

  /** Add a surface through rows of points (row by row, each of equal length) with their normals. */
  surface(rows, color) {
    const first = this.corners.length / 9;
    const width = rows[0].length;
    for (const row of rows) for (const { point, normal } of row) this.corners.push(...point, ...normal, ...color);
    for (let i = 0; i + 1 < rows.length; i++)
      for (let k = 0; k + 1 < width; k++) {
        const a = first + i * width + k;
        this.indices.push(a, a + 1, a + width, a + 1, a + width + 1, a + width);
      }
    return this;
  }

  /** Add an ellipsoid with three half axes (vectors at right angles). */
  ellipsoid(center, axes, color, fineness = 16) {
    const squares = axes.map((axis) => dot(axis, axis));
    const rows = [];
    for (let i = 0; i <= fineness / 2; i++) {
      const polar = (2 * Math.PI * i) / fineness;
      rows.push([]);
      for (let k = 0; k <= fineness; k++) {
        const around = (2 * Math.PI * k) / fineness;
        const weights = [Math.sin(polar) * Math.cos(around), Math.sin(polar) * Math.sin(around), Math.cos(polar)];
        const sum = (by) => axes.reduce((total, axis, n) => add(total, scale(axis, weights[n] * by(n))), [0, 0, 0]);
        rows[i].push({ point: add(center, sum(() => 1)), normal: unit(sum((n) => 1 / squares[n])) });
      }
    }
    return this.surface(rows, color);
  }

  sphere(radius, color, fineness) {
    return this.ellipsoid([0, 0, 0], [[radius, 0, 0], [0, radius, 0], [0, 0, radius]], color, fineness);
  }

  /** Add a body of revolution about the line from a start along an axis (unit): pairs of height and radius. */
  turned(start, axis, profile, color, fineness = 24) {
    const x = acrossTo(axis);
    const y = cross(axis, x);
    for (let i = 0; i + 1 < profile.length; i++) {
      const [[h0, r0], [h1, r1]] = [profile[i], profile[i + 1]];
      const slope = unit([h1 - h0, r0 - r1, 0]);
      const ring = (height, radius) =>
        Array.from({ length: fineness + 1 }, (_, k) => {
          const angle = (2 * Math.PI * k) / fineness;
          const out = add(scale(x, Math.cos(angle)), scale(y, Math.sin(angle)));
          return {
            point: add(add(start, scale(axis, height)), scale(out, radius)),
            normal: add(scale(out, slope[0]), scale(axis, slope[1])),
          };
        });
      this.surface([ring(h0, r0), ring(h1, r1)], color);
    }
    return this;
  }

  /** Add a closed cylinder from one point to another. */
  cylinder(from, to, radius, color, fineness) {
    const length = norm(subtract(to, from));
    const profile = [[0, 0], [0, radius], [length, radius], [length, 0]];
    return this.turned(from, unit(subtract(to, from)), profile, color, fineness);
  }
}

const COLORS = {
  plate: [0.72, 0.76, 0.8],
  post: [0.5, 0.55, 0.6],
  motor: [0.3, 0.34, 0.38],
  hub: [0.8, 0.82, 0.84],
  roller: [0.16, 0.19, 0.22],
};

/** Return the ball; its pattern is the renderer's. */
function ballMesh(robot) {
  return new Mesh().sphere(robot.ball_radius, [1, 1, 1], 48);
}

/** Return a wheel in its own frame: the axle is z. */
function wheelMesh(robot) {
  const { wheel_radius: radius, rollers } = robot;
  const half = Math.max(...rollers.offsets.map(Math.abs)) + 0.7 * rollers.radius;
  const rim = radius - 1.3 * rollers.radius;
  const mesh = new Mesh();
  // a groove in the hub for the eye to follow: it shows the turn
  mesh.turned([0, 0, -half], [0, 0, 1], [[0, 0], [0, rim], [2 * half, rim], [2 * half, 0]], COLORS.hub);
  mesh.cylinder([0.55 * rim, 0, -half - 0.001], [0.55 * rim, 0, half + 0.001], 0.2 * rim, COLORS.motor, 12);
  rollers.offsets.forEach((offset, row) => {
    for (let k = 0; k < rollers.per_row; k++) {
      const angle = (2 * Math.PI * (k + 0.5 * (row % 2))) / rollers.per_row;
      const out = [Math.cos(angle), Math.sin(angle), 0];
      const along = [-Math.sin(angle), Math.cos(angle), 0];
      const center = add(scale(out, radius - rollers.radius), [0, 0, offset]);
      const axes = [scale(out, rollers.radius), scale(along, rollers.half_length), [0, 0, rollers.radius]];
      mesh.ellipsoid(center, axes, COLORS.roller, 12);
    }
  });
  return mesh;
}

/** Return the body in its own frame, whose origin is the ball's center: plates, posts, motors, a mark in front. */
function bodyMesh(robot, color) {
  const { radius, bottom, top } = robot.body;
  const mesh = new Mesh();
  const thick = 0.02 * (top - bottom) + 0.002;
  for (const height of [bottom, bottom + 0.5 * (top - bottom), top]) {
    const plate = height === top ? color : COLORS.plate;
    mesh.turned([0, 0, height - thick / 2], [0, 0, 1], [[0, 0], [0, radius], [thick, radius], [thick, 0]], plate, 40);
  }
  for (let k = 0; k < 4; k++) {
    const angle = (Math.PI / 2) * k;
    const [x, y] = [0.85 * radius * Math.cos(angle), 0.85 * radius * Math.sin(angle)];
    mesh.cylinder([x, y, bottom], [x, y, top], 0.045 * radius, k === 0 ? color : COLORS.post, 12);
  }
  const tip = [0.7 * radius, 0, top + thick];
  mesh.turned(tip, [-1, 0, 0], [[0, 0], [0.5 * radius, 0.22 * radius], [0.5 * radius, 0]], [0.95, 0.95, 0.95]);
  for (const wheel of robot.wheels) {
    const size = 0.3 * robot.wheel_radius;
    const room = bottom - thick - wheel.center[2] - size * Math.hypot(wheel.axle[0], wheel.axle[1]);
    const reach = Math.max(room / Math.max(wheel.axle[2], 0.2), 0.5 * robot.wheel_radius);
    const end = add(wheel.center, scale(wheel.axle, reach));
    mesh.cylinder(wheel.center, end, size, COLORS.motor);
  }
  return mesh;
}

/** Return an arrow of length 1 along x, as thick as its parameter. */
function arrowMesh() {
  const profile = [[0, 0], [0, 0.5], [1, 0.5]];
  return {
    shaft: new Mesh().turned([0, 0, 0], [1, 0, 0], [...profile, [1, 0]], [1, 1, 1], 12),
    head: new Mesh().turned([0, 0, 0], [1, 0, 0], [[0, 0], [0, 1.4], [1, 0]], [1, 1, 1], 12),
  };
}

/** Return a flat strip along points on the floor, two corners a point, with its height; gaps are bridged. */
function ribbon(points, width, height) {
  const corners = [];
  points.forEach(([x, y], i) => {
    const [before, after] = [points[Math.max(i - 1, 0)], points[Math.min(i + 1, points.length - 1)]];
    const along = unit([after[0] - before[0], after[1] - before[1], 0]);
    const aside = scale([-along[1], along[0], 0], width / 2);
    corners.push(x + aside[0], y + aside[1], height, x - aside[0], y - aside[1], height);
  });
  return corners;
}
