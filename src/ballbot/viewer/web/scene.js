// The scene: each log's robot, its path and reference on the floor, and the arrows of forces at the wheels.

class Scene {
  constructor(canvas, runs, arrow) {
    this.renderer = new Renderer(canvas);
    this.runs = runs;
    this.arrow = arrow;
    this.camera = new Camera();
    this.arrowMesh = Object.fromEntries(Object.entries(arrowMesh()).map(([name, mesh]) => [name, this.renderer.mesh(mesh)]));
    this.colors = null;
  }

  /** Take the colors of a theme, 3 numbers each: ground, grid, line, reference, drive, friction, push, and one for each run. */
  paint(colors) {
    this.colors = colors;
    this.kept = this.runs.map((run, i) => this.keep(run, colors.runs[i]));
  }

  keep(run, color) {
    const { renderer } = this;
    const width = this.width(run);
    const old = this.kept && this.kept[this.runs.indexOf(run)];
    return {
      ball: old ? old.ball : renderer.mesh(ballMesh(run.robot)),
      wheel: old ? old.wheel : renderer.mesh(wheelMesh(run.robot)),
      body: renderer.mesh(bodyMesh(run.robot, color)),
      path: old ? old.path : renderer.strip(this.pathOf(run)),
      reference: old ? old.reference : run.has("ref_x") ? renderer.strip(ribbon(run.path("ref_x", "ref_y"), 1.6 * width, 0.001)) : null,
      ring: old ? old.ring : renderer.strip(ring(run.ring || 0.5 * run.robot.ball_radius, width)),
    };
  }

  width(run) {
    return 0.11 * run.robot.ball_radius;
  }

  pathOf(run) {
    return ribbon(run.path("x", "y"), this.width(run), 0.002);
  }

  /** Return the corners of a box around all that is shown, or around a robot at the origin. */
  bounds(follow) {
    const [low, high] = [[Infinity, Infinity, 0], [-Infinity, -Infinity, 0]];
    for (const run of this.runs) {
      const { body, ball_radius: ball } = run.robot;
      const wide = 0.7 * Math.max(body.radius, ball);
      for (const [axis, names] of [["x", "ref_x"], ["y", "ref_y"]].entries()) {
        const [least, greatest] = follow ? [0, 0] : run.range(names.filter((name) => run.has(name)));
        low[axis] = Math.min(low[axis], least - wide);
        high[axis] = Math.max(high[axis], greatest + wide);
      }
      high[2] = Math.max(high[2], body.top + ball);
    }
    return [low, high];
  }

  /** Draw all runs in one picture, or each in its own part of the canvas. */
  draw(time, { views, ghosts, arrows, follow }) {
    this.renderer.clear(this.colors.line);
    views.forEach((view, i) => {
      const shown = views.length < this.runs.length ? this.runs.map((_, k) => k) : [i];
      const target = this.camera.target;
      if (follow) {
        const [x, y] = this.runs[shown[0]].values(["x", "y"], time);
        this.camera.target = add(target, [x, y, 0]);
      }
      this.renderer.begin(view, this.camera, this.colors);
      this.camera.target = target;
      for (const k of shown) this.drawPaths(this.runs[k], this.kept[k], this.colors.runs[k], time);
      const parts = shown.map((k) => this.parts(this.runs[k], this.kept[k], this.colors.runs[k], time, ghosts && k > 0));
      this.renderer.drawShadow(parts.flat(), this.colors.shadow);
      parts.forEach((part, rank) => this.renderer.drawMeshes(part, ghosts && rank > 0 ? 0.4 : 1));
      if (arrows && this.arrow) {
        this.renderer.overlay();
        for (const k of shown) this.renderer.drawMeshes(this.arrows(this.runs[k], time), 0.92);
      }
    });
  }

  drawPaths(run, kept, color, time) {
    const { renderer, colors } = this;
    if (kept.reference) {
      renderer.drawStrip(kept.reference, [...colors.reference, 0.55]);
      const [x, y] = run.values(["ref_x", "ref_y"], time);
      const at = frame([1, 0, 0], [0, 1, 0], [0, 0, 1], [x, y, 0]);
      const screen = renderer.screen;
      renderer.screen = multiply(screen, at);
      renderer.drawStrip(kept.ring, [...colors.reference, 0.9]);
      renderer.screen = screen;
    }
    if (run.grown) renderer.restrip(kept.path, this.pathOf(run));  // a live one
    run.grown = false;
    renderer.drawStrip(kept.path, [...color, 0.95], 2 * (run.place(time)[0] + 1));
  }

  /** Return the meshes of one robot at a time; of a ghost all in one color. */
  parts(run, kept, color, time, ghost) {
    const pose = run.pose(time);
    const tint = ghost ? { tint: color } : {};
    return [
      { mesh: kept.ball, model: pose.ball, pattern: color },
      { mesh: kept.body, model: pose.body, ...tint },
      ...pose.wheels.map((model) => ({ mesh: kept.wheel, model, ...tint })),
    ];
  }

  /** Return the arrows of the wheels' forces on the ball: the motors' and the friction's, and of the floor's on the ball. */
  arrows(run, time) {
    const { metres, newtons } = this.arrow;
    const pose = run.pose(time);
    const arrows = [];
    const push = (from, force, color) => {
      const length = (norm(force) * metres) / newtons;
      if (!(length > 0.004)) return;
      const x = unit(force);
      const y = acrossTo(x);
      const z = cross(x, y);
      const thick = 0.1 * run.robot.ball_radius;
      const head = Math.min(0.5 * length, 2.4 * thick);
      const at = (start, size) => frame(scale(x, size), scale(y, thick), scale(z, thick), start);
      arrows.push({ mesh: this.arrowMesh.shaft, model: at(from, length - head), tint: color, flatness: 0.4 });
      arrows.push({ mesh: this.arrowMesh.head, model: at(add(from, scale(x, length - head)), head), tint: color, flatness: 0.4 });
    };
    run.robot.wheels.forEach((wheel, i) => {
      const contact = transform(pose.body, scale(wheel.contact, run.robot.ball_radius));
      const along = turn(pose.body, wheel.rolling);
      const out = turn(pose.body, scale(wheel.axle, -0.35 * run.robot.wheel_radius));
      if (run.has(`u${i + 1}_low`)) {
        const torque = 0.5 * (run.held(`u${i + 1}_low`, time) + run.held(`u${i + 1}_high`, time));
        push(contact, scale(along, torque / run.robot.wheel_radius), this.colors.drive);
      }
      if (run.has(`friction${i + 1}`)) {
        const torque = run.held(`friction${i + 1}`, time);
        push(add(contact, out), scale(along, -torque / run.robot.wheel_radius), this.colors.friction);
      }
    });
    if (run.has("push_x")) {
      const [x, y, height] = run.values(["push_x", "push_y", "push_height"], time);
      push(transform(pose.body, [0, 0, height]), [x, y, 0], this.colors.push);
    }
    if (run.has("floor_x")) {
      const [x, y] = [run.held("floor_x", time), run.held("floor_y", time)];
      push(add(pose.center, [0, 0, 0.02 - run.robot.ball_radius]), [x, y, 0], this.colors.friction);
    }
    return arrows;
  }
}

/** Return a flat ring on the floor about the origin. */
function ring(radius, width) {
  const points = Array.from({ length: 49 }, (_, k) => {
    const angle = (2 * Math.PI * k) / 48;
    return [radius * Math.cos(angle), radius * Math.sin(angle), 0];
  });
  return ribbon(points, width, 0.0015);
}
