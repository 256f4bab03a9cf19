// A live simulation: frames come through a web socket, and pushes, settings and resets go back.

const HISTORY = 1000;  // rows in the plots
const TRAIL = 700;  // points of a path, each at least this far [m] from the one before
const TRAIL_STEP = 0.01;
const REFRESH = 100;  // time between two drawings of the plots [ms]
const SEND = 40;  // and between two pushes or places of the reference that are sent while dragging [ms]
const SPRING = 2.5;  // of the mouse: its natural frequency with the robot's mass [rad/s]; critically damped
const LIVE_SIGNALS = [
  { name: "distance from the reference", short: "off by", unit: "mm", column: "distance" },
  { name: "lean", short: "lean", unit: "°", column: "lean" },
  { name: "largest wheel torque", short: "torque", unit: "N m", column: "torque" },
  { name: "heading", short: "heading", unit: "°", column: "heading" },
];
const HINT = "Drag a robot to push it, or the ring around it to move its reference.";
const COMPENSATIONS = [["own", "as the controller has it"], ["none", "none"], ["partial", "partial"], ["full", "full"]];
const MOTIONS = [["hold", "stands"], ["square", "square"], ["circle", "circle"], ["figure_eight", "figure of eight"]];
const PACES = [["1", "Real time"], ["0.5", "½ speed"], ["0.25", "¼ speed"], ["0.1", "⅒ speed"]];

/** One robot: its newest values, its path, and the last seconds of its signals. */
class LiveRun extends Run {
  constructor(given) {
    super({ ...given, columns: {}, rows: HISTORY, signals: LIVE_SIGNALS.map((signal) => ({ ...signal, columns: [signal.column] })) });
    const rest = { ball_w: 1, x: given.home[0], y: given.home[1], ref_x: given.home[0], ref_y: given.home[1] };
    this.now = { ...Object.fromEntries(given.names.map((name) => [name, 0])), ...rest };
    this.ring = 1.9 * this.robot.ball_radius;
    this.columns = Object.fromEntries(LIVE_SIGNALS.map((signal) => [signal.column, new Float32Array(HISTORY).fill(NaN)]));
    this.trail = [];
    this.derive();
  }

  has(name) {
    return name in this.now;
  }

  value(name) {
    return this.now[name];
  }

  held(name) {
    return this.now[name];
  }

  reading(signal) {
    return this.now[signal.column];
  }

  place() {
    return [this.trail.length - 1, 0];
  }

  path(x) {
    return x === "x" ? this.trail : [];
  }

  /** Return a range around where it starts, for the first view. */
  range(names) {
    const middle = this.home[names[0].endsWith("x") ? 0 : 1];
    return [middle - 4 * this.robot.ball_radius, middle + 4 * this.robot.ball_radius];
  }

  ended() {
    return false;
  }

  /** Take a frame's values; `rows` is how many new rows the plots have, the newest at a time. */
  take(values, time, rows) {
    this.names.forEach((name, k) => (this.now[name] = values[k]));
    this.derive();
    this.start = time - (HISTORY - 1) * this.interval;
    if (rows > 0) {
      for (const [name, column] of Object.entries(this.columns)) {
        if (rows < HISTORY) column.copyWithin(0, rows);
        column.fill(NaN, Math.max(HISTORY - rows, 0));
        column[HISTORY - 1] = this.now[name];
      }
    }
    const { x, y } = this.now;
    const last = this.trail[this.trail.length - 1];
    if (last && !(Math.hypot(x - last[0], y - last[1]) > TRAIL_STEP)) return;
    if (last && Math.hypot(x - last[0], y - last[1]) > 0.5) this.trail = [];  // it was put elsewhere
    this.trail.push([x, y, 0]);
    if (this.trail.length > TRAIL) this.trail.shift();
    this.grown = true;
  }

  derive() {
    const now = this.now;
    now.distance = 1000 * Math.hypot(now.x - now.ref_x, now.y - now.ref_y);
    now.lean = (180 / Math.PI) * Math.acos(Math.min(Math.max(Math.cos(now.theta) * Math.cos(now.phi), -1), 1));
    now.heading = (180 / Math.PI) * now.psi;
    const torques = this.robot.wheels.map((_, i) => now[`u${i + 1}`]);
    now.torque = Math.max(...torques.map(Math.abs));
    torques.forEach((torque, i) => (now[`u${i + 1}_low`] = now[`u${i + 1}_high`] = torque));
  }
}

class Live extends View {
  constructor(root, data) {
    super(root, data, data.runs.map((run) => new LiveRun(run)), { ghosts: false, arrows: true, follow: false });
    root.classList.add("ballbot-live");
    this.settings = { paused: false, motors: true, motion: "hold" };
    this.reasons = [];
    this.newest = 0;  // time of the newest row in the plots
    this.inputs = {};
    this.makeControls();
    this.makePanels();
    this.makeNotes();
    this.repaint();
    this.watch();
    this.listen();
    this.connect();
  }

  viewCount() {
    return 1;
  }

  keyOfReference(entry) {
    entry("ring", "reference (drag it)");
  }

  makeControls() {
    const bar = element("div", { class: "controls" }, this.root);
    this.makePace(bar);
    this.toggle(bar, "Follow robot", "follow", () => (this.fitted = false));
    this.toggle(bar, "Forces", "arrows", () => this.makeKey());
    this.state = element("output", { class: "state", "aria-live": "polite", text: "Connecting …" }, this.root);
    this.makeTools();
  }

  makePace(bar) {
    this.button = this.press(bar, "Pause", "play", () => this.change({ paused: !this.settings.paused }));
    this.press(bar, "Reset", "reset", () => this.reset());
    this.inputs.pace = this.choice(bar, "Speed", PACES, "1", (value) => this.change({ pace: Number(value) }));
    const motors = element("label", { class: "motors" }, bar);
    this.inputs.motors = element("input", { type: "checkbox" }, motors);
    motors.append("Motors");
    this.inputs.motors.checked = true;
    this.inputs.motors.addEventListener("change", () => this.change({ motors: this.inputs.motors.checked }));
  }

  makeTools() {
    const tools = element("div", { class: "tools" }, this.root);
    this.makePush(tools);
    const controller = this.group(tools, "Compensation");
    const compensate = (value) => this.change({ compensation: value });
    this.inputs.compensation = this.choice(controller, "Friction compensation", COMPENSATIONS, "own", compensate);
    const percent = (value) => `${shortNumber(100 * value)} %`;
    const friction = this.group(tools, "Friction and floor");
    this.slide(friction, "friction", "Wheels", [0, 3, 0.05], (value) => `${shortNumber(value)} ×`);
    this.slide(friction, "rolling", "Rolling", [0, 0.04, 0.0005], percent);
    this.slide(friction, "slope_x", "Slope", [-0.06, 0.06, 0.0025], percent);
    const reference = this.group(tools, "Reference");
    this.inputs.motion = this.choice(reference, "Motion of the reference", MOTIONS, "hold", (value) => this.change({ motion: value }));
    this.slide(reference, "psi", "Heading", [-3.14, 3.14, 0.02], (value) => withUnit((180 / Math.PI) * value, "°"));
  }

  group(parent, name) {
    const box = element("fieldset", {}, parent);
    element("legend", { text: name }, box);
    return box;
  }

  press(parent, text, name, act) {
    const button = element("button", { type: "button", class: name, text }, parent);
    button.addEventListener("click", act);
    return button;
  }

  /** Add a slider of a setting. */
  slide(parent, name, text, [min, max, step], write) {
    const label = element("label", { class: "slide" }, parent);
    element("span", { text }, label);
    const input = element("input", { type: "range", min, max, step, value: 0, "aria-label": text }, label);
    const shown = element("output", {}, label);
    const show = () => (shown.textContent = write(Number(input.value)));
    input.addEventListener("input", () => {
      show();
      this.often(name, () => this.change({ [name]: Number(input.value) }));
    });
    input.show = show;
    show();
    if (name) this.inputs[name] = input;
    return input;
  }

  makePush(parent) {
    const box = this.group(parent, "Push");
    const mass = Math.max(...this.runs.map((run) => run.mass));
    this.size = this.slide(box, "", "Size", [0.05 * mass, 0.5 * mass, 0.01 * mass], (value) => withUnit(value, "N s"));
    this.size.value = 0.15 * mass;
    this.size.show();
    const pad = element("div", { class: "pad" }, box);
    const arrows = [["←", "Push left", [-1, 0]], ["↑", "Push away", [0, 1]], ["↓", "Push nearer", [0, -1]], ["→", "Push right", [1, 0]]];
    for (const [text, name, way] of arrows) this.press(pad, text, "arrow", () => this.kick(way)).setAttribute("aria-label", name);
  }

  makePanels() {
    const names = LIVE_SIGNALS.map((signal) => signal.name);
    const box = element("div", { class: "panels" }, this.root);
    this.panels = names.slice(0, 3).map((name) => new Panel(box, this.runs, names, name, () => {}));
  }

  makeNotes() {
    const box = element("details", { class: "notes" }, this.root);
    element("summary", { text: "What is shown, and the keys" }, box);
    const list = element("ul", {}, box);
    const keys = [
      `${HINT} Drag anything else to orbit.`,
      "Space: pause. R: reset. Arrow keys: push, as seen from here.",
    ];
    for (const note of [...keys, ...this.data.notes]) element("li", { text: note }, list);
  }

  /** Read keys, and take what is dragged in the picture before the camera does. */
  listen() {
    document.addEventListener("keydown", (event) => this.readKey(event));
    this.stage.addEventListener("pointerdown", (event) => this.grab(event), { capture: true });
    this.stage.addEventListener("pointermove", (event) => this.drag(event), { capture: true });
    for (const end of ["pointerup", "pointercancel"]) this.stage.addEventListener(end, () => this.release(), { capture: true });
  }

  readKey(event) {
    const tag = event.target.tagName;
    if (event.repeat || event.ctrlKey || event.metaKey || event.altKey || tag === "SELECT") return;
    if (tag === "INPUT" && event.target.type === "range" && event.key.startsWith("Arrow")) return;
    if (/^(INPUT|BUTTON|SUMMARY)$/.test(tag) && event.key === " ") return;
    const actions = {
      " ": () => this.change({ paused: !this.settings.paused }),
      r: () => this.reset(),
      ArrowLeft: () => this.kick([-1, 0]),
      ArrowRight: () => this.kick([1, 0]),
      ArrowUp: () => this.kick([0, 1]),
      ArrowDown: () => this.kick([0, -1]),
    };
    const act = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  /** Return the horizontal direction of a way in the picture: to the right, and away from the eye. */
  direction([right, away]) {
    const { azimuth } = this.scene ? this.scene.camera : new Camera();
    const [s, c] = [Math.sin(azimuth), Math.cos(azimuth)];
    return [-s * right - c * away, c * right - s * away];
  }

  /** Push every robot for a tenth of a second. */
  kick(way) {
    const duration = 0.1;
    const force = this.direction(way).map((part) => (part * Number(this.size.value)) / duration);
    this.send({ push: { force, height: this.runs[0].center, duration } });
  }

  grab(event) {
    if (!this.scene || event.button !== 0 || event.shiftKey || event.target !== this.canvas) return;
    const ray = this.ray(event);
    const robot = this.robotAt(ray);
    if (robot) this.held = { ...robot, kind: "robot", at: [event.clientX, event.clientY] };
    else this.held = this.ringAt(ray);
    if (!this.held) return;
    event.stopPropagation();
    event.preventDefault();
    this.canvas.focus();
    this.held.pointer = event.pointerId;
    this.stage.setPointerCapture(event.pointerId);
  }

  drag(event) {
    if (!this.held && this.scene && !event.buttons) {
      const ray = this.ray(event);
      this.canvas.style.cursor = this.robotAt(ray) ? "pointer" : this.ringAt(ray) ? "move" : "";
    }
    if (!this.held || event.pointerId !== this.held.pointer) return;
    event.stopPropagation();
    if (this.held.kind === "robot") {
      this.held.at = [event.clientX, event.clientY];
      this.pull();
      return;
    }
    const [x, y] = this.floorAt(this.ray(event)) || [];
    if (x === undefined) return;
    const near = (value) => Math.min(Math.max(value, -20), 20);
    const [from, begun] = [this.held.floor, this.held.begun];
    const target = { x: near(begun[0] + x - from[0]), y: near(begun[1] + y - from[1]) };
    this.often("reference", () => this.change(target));
  }

  release() {
    if (this.held && this.held.kind === "robot")
      this.later("pull", () => this.send({ push: { force: [0, 0], height: 0, duration: 0.02, robot: this.last } }));
    this.held = null;
  }

  /** Push the robot that is held as a damped spring between it and the pointer would. */
  pull() {
    const { index, height } = this.held;
    this.last = index;
    const run = this.runs[index];
    const point = transform(run.pose(0).body, [0, 0, height]);
    const { camera } = this.scene;
    const [origin, direction] = this.ray({ clientX: this.held.at[0], clientY: this.held.at[1] });
    const [right, up, back] = camera.axes();
    const depth = dot(subtract(point, origin), back) / dot(direction, back);
    const away = subtract(add(origin, scale(direction, depth)), point);
    const way = this.direction([dot(away, right), dot(away, up)]);
    const speed = this.speedOf(point);
    const force = way.map((offset, axis) => run.mass * (SPRING ** 2 * offset - 2 * SPRING * speed[axis]));
    this.often("pull", () => this.send({ push: { force, height, duration: 0.3, robot: index } }));
  }

  /** Return the velocity of the point that is held, between the frames. */
  speedOf(point) {
    const before = this.held.before || { point, time: this.time, speed: [0, 0] };
    const passed = this.time - before.time;
    if (this.held.before && !(passed > 0)) return before.speed;
    const speed = passed > 0 ? [0, 1].map((axis) => (point[axis] - before.point[axis]) / passed) : before.speed;
    this.held.before = { point, time: this.time, speed };
    return speed;
  }

  /** Return the eye and the direction from it through the pointer. */
  ray(event) {
    const { camera } = this.scene;
    const box = this.canvas.getBoundingClientRect();
    const at = [event.clientX - box.left, event.clientY - box.top];
    const shift = this.show.follow ? [this.runs[0].now.x, this.runs[0].now.y, 0] : [0, 0, 0];
    return [add(camera.eye(), shift), camera.ray(at, [box.width, box.height])];
  }

  /** Return the robot that a ray meets first, and the height on its axis; null if it meets none. */
  robotAt([origin, direction]) {
    let nearest = null;
    this.runs.forEach((run, index) => {
      const { body, ball_radius: ball } = run.robot;
      const matrix = run.pose(0).body;
      for (let k = 0; k <= 14; k++) {
        const height = (body.top * k) / 14;
        const from = subtract(transform(matrix, [0, 0, height]), origin);
        const depth = dot(from, direction);
        const reach = 1.1 * (height > body.bottom ? body.radius : ball);
        if (norm(cross(from, direction)) < reach && (!nearest || depth < nearest.depth)) nearest = { index, height, depth };
      }
    });
    return nearest;
  }

  floorAt([origin, direction]) {
    const depth = -origin[2] / direction[2];
    return depth > 0 ? add(origin, scale(direction, depth)).slice(0, 2) : null;
  }

  /** Return the reference whose ring a ray meets; null if it meets none. */
  ringAt(ray) {
    const floor = this.floorAt(ray);
    const near = (run) => {
      const distance = Math.hypot(floor[0] - run.now.ref_x, floor[1] - run.now.ref_y);
      return distance < 1.35 * run.ring;
    };
    if (!floor || !this.runs.some(near)) return null;
    return { kind: "reference", floor, begun: [this.settings.x || 0, this.settings.y || 0] };
  }

  /** Do something at most once in a while, and the last of it in any case. */
  often(name, act) {
    this.waits = this.waits || {};
    const begun = name in this.waits;
    this.waits[name] = act;
    if (begun) return;
    act();
    this.waits[name] = null;
    setTimeout(() => {
      const last = this.waits[name];
      delete this.waits[name];
      if (last) this.often(name, last);
    }, SEND);
  }

  /** Do something in place of what waits under a name. */
  later(name, act) {
    if (this.waits && name in this.waits) this.waits[name] = act;
    else act();
  }

  reset() {
    for (const run of this.runs) run.trail = [];
    this.send({ reset: true });
  }

  change(changes) {
    Object.assign(this.settings, changes);
    this.send({ change: changes });
    this.showSettings();
  }

  send(request) {
    if (this.socket && this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(request));
  }

  connect() {
    this.socket = new WebSocket(`ws://${location.host}/live${location.search}`);
    this.socket.binaryType = "arraybuffer";
    this.socket.addEventListener("message", ({ data }) => (typeof data === "string" ? this.hear(JSON.parse(data)) : this.frames(data)));
    this.socket.addEventListener("close", () => {
      this.state.textContent = "The simulation cannot be reached; it is tried again.";
      setTimeout(() => this.connect(), 1500);
    });
  }

  /** Take a status: what changes seldom. */
  hear({ message, settings, ended }) {
    this.message = message;
    this.reasons = ended;
    Object.assign(this.settings, settings);
    this.showSettings();
    this.showState(1);
    this.request();
  }

  showSettings() {
    for (const [name, input] of Object.entries(this.inputs)) {
      if (!(name in this.settings) || input.matches(":active")) continue;
      if (input.type === "checkbox") input.checked = this.settings[name];
      else input.value = this.settings[name];
      if (input.show) input.show();
    }
    this.button.textContent = this.settings.paused ? "Resume" : "Pause";
    this.button.dataset.state = this.settings.paused ? "paused" : "running";
  }

  showState(rate) {
    if (this.socket.readyState !== WebSocket.OPEN) return;
    const slow = `The simulation runs at ${Math.round(100 * rate)} % of the speed: the computer is busy.`;
    const fallen = this.reasons.filter(Boolean).length;
    const running = rate < 0.9 ? slow : `Running. ${HINT}`;
    const state = this.settings.paused ? "Paused." : fallen ? "Fallen: press R or Reset." : running;
    const text = `${state} ${this.message || ""}`.trim();
    if (this.state.textContent !== text) this.state.textContent = text;
  }

  /** Take frames: rows of floats, the world's values and then each robot's. */
  frames(data) {
    const values = new Float32Array(data);
    const size = this.data.world.length + this.runs.reduce((sum, run) => sum + run.names.length, 0);
    for (let first = 0; first + size <= values.length; first += size) {
      const time = values[first];
      const rows = Math.max(0, Math.min(HISTORY, Math.floor((time - this.newest) / this.runs[0].interval + 0.01)));
      if (rows > 0) this.newest = time;
      this.time = time;
      let from = first + this.data.world.length;
      for (const run of this.runs) {
        run.take(values.subarray(from, from + run.names.length), this.newest, rows);
        from += run.names.length;
      }
      this.rate = values[first + this.data.world.indexOf("rate")];
    }
    if (this.held && this.held.kind === "robot") this.pull();
    this.request();
  }

  step(now) {
    this.drawPicture();
    if (now - (this.drawn || 0) < REFRESH) return;
    this.drawn = now;
    this.showState(this.rate || 1);
    const span = [Math.max(this.runs[0].start, 0), Math.max(this.time, 5)];
    for (const panel of this.panels) {
      panel.refresh();  // its rows are new even where its span is not
      panel.draw(this.time, span, this.colors);
    }
  }

  live(run) {
    const reason = this.reasons[this.runs.indexOf(run)];
    if (reason) return reason;
    const [distance, lean] = LIVE_SIGNALS;
    return [distance, lean].map((signal) => `${signal.short} ${withUnit(run.reading(signal), signal.unit)}`).join(" · ");
  }
}

for (const root of document.querySelectorAll("[data-ballbot-live]"))
  new Live(root, JSON.parse(document.getElementById(root.dataset.ballbotLive).textContent));
