// The page: picture, controls, panels; one for each element with the attribute data-ballbot-replay.

const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 4];
const SPANS = [0, 20, 5, 1];
const DEFAULT_PANELS = ["distance from the reference", "lean", "largest wheel torque"];

/** Return a new element with attributes (`text` is its content), put into a parent. */
function element(tag, attributes, parent) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "text") made.textContent = value;
    else made.setAttribute(name, value);
  }
  if (parent) parent.append(made);
  return made;
}

/** Return a color of the style sheet as three numbers from 0 to 1. */
function colorOf(style, name) {
  const [, digits] = style.getPropertyValue(name).match(/#([0-9a-f]{6})/i);
  return [0, 2, 4].map((k) => parseInt(digits.slice(k, k + 2), 16) / 255);
}

class Replay {
  constructor(root, data) {
    this.root = root;
    this.data = data;
    this.runs = data.runs.map((run) => new Run(run));
    this.duration = Math.max(...this.runs.map((run) => run.duration));
    this.time = 0;
    this.playing = false;
    this.speed = 1;
    this.window = 0;
    this.show = { ghosts: data.layout === "ghosts", arrows: true, follow: false };
    this.panels = [];
    root.classList.add("ballbot-replay");
    root.replaceChildren();
    this.makeStage();
    if (this.duration > 0) {
      this.makeControls();
      this.makePanels();
    }
    this.makeNotes();
    this.repaint();
    this.watch();
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (data.autoplay && this.duration > 0 && !still) this.play();
  }

  makeStage() {
    this.stage = element("div", { class: "stage" }, this.root);
    this.canvas = element("canvas", { class: "picture", role: "img", tabindex: "0" }, this.stage);
    this.canvas.setAttribute("aria-label", "Robot in three dimensions; drag to orbit, wheel or pinch to zoom");
    this.labels = this.runs.map((run, i) => {
      const label = element("div", { class: `label run${i}` }, this.stage);
      element("strong", { text: run.name }, label);
      label.live = element("span", { class: "live" }, label);
      return label;
    });
    this.key = element("div", { class: "key" }, this.stage);
    try {
      this.scene = new Scene(this.canvas, this.runs, this.data.arrow);
    } catch (error) {
      const text = `The 3-D picture needs WebGL 2, which this browser does not offer here (${error.message}).`;
      element("p", { class: "no-picture", text }, this.stage);
      return;
    }
    controlCamera(this.scene.camera, this.canvas, () => this.request());
    this.canvas.addEventListener("dblclick", () => {
      this.fitted = false;
      this.request();
    });
  }

  makeControls() {
    const bar = element("div", { class: "controls" }, this.root);
    this.button = element("button", { type: "button", class: "play" }, bar);
    this.button.addEventListener("click", () => (this.playing ? this.pause() : this.play()));
    const range = { type: "range", min: 0, max: this.duration, step: "any", value: 0, class: "time" };
    this.slider = element("input", { ...range, "aria-label": "Time" }, bar);
    this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
    this.clock = element("output", { class: "clock" }, bar);
    const speeds = SPEEDS.map((one) => [String(one), one === 1 ? "1× speed" : `${one}×`]);
    this.choice(bar, "Speed", speeds, "1", (value) => (this.speed = Number(value)));
    const options = element("div", { class: "options" }, this.root);
    if (this.runs.length > 1) {
      const layouts = [["side", "Side by side"], ["ghosts", "Ghosts"]];
      this.choice(options, "Layout", layouts, this.show.ghosts ? "ghosts" : "side", (value) => {
        this.show.ghosts = value === "ghosts";
        this.fitted = false;
      });
    }
    this.toggle(options, "Follow robot", "follow", () => (this.fitted = false));
    if (this.data.arrow && this.scene) this.toggle(options, "Forces", "arrows", () => this.makeKey());
    const spans = SPANS.map((one) => [String(one), one ? `Plots: ${one} s` : "Plots: whole log"]);
    this.choice(options, "Time span of the plots", spans, "0", (value) => (this.window = Number(value)));
    this.root.addEventListener("keydown", (event) => this.press(event));
    if (this.data.autoplay) document.addEventListener("keydown", (event) => event.target === document.body && this.press(event));
    this.pause();
  }

  choice(parent, name, entries, chosen, change) {
    const select = element("select", { "aria-label": name }, parent);
    for (const [value, text] of entries) element("option", { value, text }, select);
    select.value = chosen;
    select.addEventListener("change", () => {
      change(select.value);
      this.request();
    });
  }

  toggle(parent, text, name, change) {
    const label = element("label", {}, parent);
    const box = element("input", { type: "checkbox" }, label);
    label.append(text);
    box.checked = this.show[name];
    box.addEventListener("change", () => {
      this.show[name] = box.checked;
      change();
      this.request();
    });
  }

  makePanels() {
    const names = [...new Set(this.runs.flatMap((run) => run.signals.map((one) => one.name)))];
    const chosen = [...DEFAULT_PANELS.filter((one) => names.includes(one)), ...names].slice(0, 3);
    const box = element("div", { class: "panels" }, this.root);
    const seek = (time) => this.seek(time);
    this.panels = [...new Set(chosen)].map((name) => new Panel(box, this.runs, names, name, seek));
    for (const panel of this.panels) panel.select.addEventListener("change", () => this.request());
  }

  makeNotes() {
    const box = element("details", { class: "notes" }, this.root);
    element("summary", { text: "What is shown" }, box);
    for (const run of this.runs) {
      element("h4", { text: run.name }, box);
      const list = element("ul", {}, box);
      for (const note of run.notes) element("li", { text: note }, list);
    }
  }

  makeKey() {
    this.key.replaceChildren();
    const entry = (name, text) => {
      const line = element("span", { class: `entry ${name}` }, this.key);
      line.append(text);
    };
    if (this.runs.some((run) => run.has("ref_x"))) entry("reference", "reference");
    if (this.show.arrows && this.data.arrow) {
      entry("drive", "motor force");
      if (this.runs.some((run) => run.has("friction1"))) entry("friction", "friction");
      const { newtons, metres } = this.data.arrow;
      entry("scale", `${newtons} N = ${shortNumber(100 * metres)} cm`);
    }
    if (this.scene) this.grid = element("span", { class: "entry" }, this.key);
  }

  /** Take the colors of the theme, and draw everything again. */
  repaint() {
    const style = getComputedStyle(this.root);
    const css = this.runs.map((_, i) => style.getPropertyValue(`--run${i % 4}`));
    const plain = (name) => style.getPropertyValue(name);
    this.colors = { ink: plain("--ink"), muted: plain("--muted"), line: plain("--line"), css };
    if (this.scene) {
      const named = ["ground", "grid", "line", "reference", "drive", "friction"].map((name) => [name, colorOf(style, `--${name}`)]);
      const runs = this.runs.map((_, i) => colorOf(style, `--run${i % 4}`));
      this.scene.paint({ ...Object.fromEntries(named), runs, shadow: Number(plain("--shadow")) });
    }
    for (const panel of this.panels) panel.refresh();
    this.makeKey();
    this.request();
  }

  watch() {
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.repaint());
    new MutationObserver(() => this.repaint()).observe(document.documentElement, { attributeFilter: ["data-theme"] });
    new ResizeObserver(() => {
      if (!this.moved) this.fitted = false;
      this.request();
    }).observe(this.root);
  }

  press(event) {
    if (/^(INPUT|SELECT|BUTTON|SUMMARY)$/.test(event.target.tagName) && event.key !== "Escape") return;
    const step = event.shiftKey ? 1 : 0.1;
    const actions = {
      " ": () => (this.playing ? this.pause() : this.play()),
      ArrowLeft: () => this.seek(this.time - step),
      ArrowRight: () => this.seek(this.time + step),
      Home: () => this.seek(0),
      End: () => this.seek(this.duration),
    };
    if (!(event.key in actions)) return;
    event.preventDefault();
    event.stopPropagation();
    actions[event.key]();
  }

  play() {
    if (this.time >= this.duration) this.time = 0;
    this.playing = true;
    this.last = null;
    this.showState("Pause");
    this.request();
  }

  pause() {
    this.playing = false;
    this.showState("Play");
  }

  showState(name) {
    this.button.textContent = name;
    this.button.dataset.state = name.toLowerCase();
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    this.last = null;
    this.request();
  }

  request() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame((now) => {
      this.waiting = false;
      this.step(now);
    });
  }

  /** Advance the time while playing, and draw. */
  step(now) {
    if (this.playing) {
      if (this.last !== null) this.time += this.speed * Math.min((now - this.last) / 1000, 0.25);
      this.last = now;
      if (this.time >= this.duration) {
        this.time = this.duration;
        this.pause();
      }
    }
    this.drawPicture();
    if (this.duration > 0) this.drawTime();
    if (this.playing) this.request();
  }

  /** Return the parts of the canvas, one for each log or one for all: pixels from the lower left. */
  views(width, height) {
    const count = this.show.ghosts ? 1 : this.runs.length;
    const across = width > 1.1 * height;
    const size = Math.floor((across ? width : height) / count);
    const gap = count > 1 ? 2 : 0;
    return Array.from({ length: count }, (_, i) =>
      across ? [i * size, 0, size - gap, height] : [0, (count - 1 - i) * size + gap, width, size - gap],
    );
  }

  drawPicture() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (!width || !height) return;
    const views = this.views(width, height);
    this.placeLabels(views, height);
    if (!this.scene) return;
    const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width !== w || this.canvas.height !== h) [this.canvas.width, this.canvas.height] = [w, h];
    if (!this.fitted) {
      this.fit(views[0][2] / views[0][3]);
      this.fitted = true;
    }
    this.scene.draw(this.time, { ...this.show, views: views.map((view) => view.map((one) => one * ratio)) });
    this.grid.textContent = `grid ${Number((100 * this.scene.camera.gridSpacing()).toPrecision(1))} cm`;
  }

  fit(aspect) {
    this.scene.camera.fit(...this.scene.bounds(this.show.follow), aspect);
  }

  placeLabels(views, height) {
    this.labels.forEach((label, i) => {
      const view = views[this.show.ghosts ? 0 : i];
      label.style.left = `${view[0] + 12}px`;
      label.style.top = `${height - view[1] - view[3] + 10 + (this.show.ghosts ? 44 * i : 0)}px`;
      label.style.maxWidth = `${view[2] - 24}px`;
      const run = this.runs[i];
      label.live.textContent = this.duration > 0 ? this.live(run) : "";
    });
  }

  live(run) {
    if (run.ended(this.time)) return `log ends at ${run.duration.toFixed(1)} s`;
    const names = ["distance from the reference", "lean"];
    return run.signals
      .filter((one) => names.includes(one.name))
      .map((one) => `${one.short} ${withUnit(run.reading(one, this.time), one.unit)}`)
      .join(" · ");
  }

  drawTime() {
    this.slider.value = this.time;
    this.clock.textContent = `${this.time.toFixed(2)} / ${this.duration.toFixed(1)} s`;
    const width = this.window || this.duration;
    const start = Math.min(Math.max(this.time - width / 2, 0), Math.max(this.duration - width, 0));
    const span = [start, Math.min(start + width, this.duration)];
    for (const panel of this.panels) panel.draw(this.time, span, this.colors);
  }
}

/** Let a button switch the page between the light and the dark theme; the browser's own comes first. */
function switchTheme(button) {
  const root = document.documentElement;
  const dark = () => (root.dataset.theme || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
  const show = () => (button.textContent = dark() ? "Light theme" : "Dark theme");
  button.addEventListener("click", () => {
    root.dataset.theme = dark() ? "light" : "dark";
    show();
  });
  show();
}

for (const root of document.querySelectorAll("[data-ballbot-replay]"))
  new Replay(root, JSON.parse(document.getElementById(root.dataset.ballbotReplay).textContent));
for (const button of document.querySelectorAll("[data-ballbot-theme]")) switchTheme(button);
