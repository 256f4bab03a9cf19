// What every page has: a picture with labels and a key, choices, and the colors of the theme.

/** Return a color of the style sheet as three numbers from 0 to 1. */
function colorOf(style, name) {
  const [, digits] = style.getPropertyValue(name).match(/#([0-9a-f]{6})/i);
  return [0, 2, 4].map((k) => parseInt(digits.slice(k, k + 2), 16) / 255);
}

/** A picture of runs in an element. A page of its own kind adds `live`, the text at a label, and `step`, which draws. */
class View {
  constructor(root, data, runs, show) {
    this.root = root;
    this.data = data;
    this.runs = runs;
    this.show = show;
    this.time = 0;
    this.panels = [];
    root.classList.add("ballbot-replay");
    root.replaceChildren();
    this.makeStage();
  }

  makeStage() {
    this.stage = element("div", { class: "stage" }, this.root);
    this.canvas = element("canvas", { class: "picture", role: "img", tabindex: "0" }, this.stage);
    this.canvas.setAttribute("aria-label", "Robot in three dimensions; drag to orbit, wheel or pinch to zoom");
    this.labels = this.runs.map((run) => {
      const label = element("div", { class: `label run-${run.color}` }, this.stage);
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

  choice(parent, name, entries, chosen, change) {
    const select = element("select", { "aria-label": name }, parent);
    for (const [value, text] of entries) element("option", { value, text }, select);
    select.value = chosen;
    select.addEventListener("change", () => {
      change(select.value);
      this.request();
    });
    return select;
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

  makeKey() {
    this.key.replaceChildren();
    const entry = (name, text) => {
      return element("span", { class: `entry ${name}`, text }, this.key);
    };
    const paths = [...new Set(this.runs.map((run) => `var(--run-${run.color})`))];
    const stops = paths.map((color, i) => `${color} ${(100 * i) / paths.length}% ${(100 * (i + 1)) / paths.length}%`);
    entry("path", "path of the ball").style.setProperty("--paths", stops.join(", "));
    if (this.runs.some((run) => run.has("ref_x"))) this.keyOfReference(entry);
    if (this.show.arrows && this.data.arrow) {
      entry("drive", "motor forces on the ball");
      if (this.runs.some((run) => run.has("friction1"))) entry("friction", "friction");
      if (this.runs.some((run) => run.has("push_x"))) entry("push", "push");
      const { newtons, metres } = this.data.arrow;
      entry("scale", `arrows: ${newtons} N = ${shortNumber(100 * metres)} cm`);
    }
    if (this.scene) this.grid = element("span", { class: "entry" }, this.key);
  }

  /** Name what shows the reference on the floor: a line where it goes, and a ring where it is. */
  keyOfReference(entry) {
    entry("reference", "reference");
    entry("ring", "reference now");
  }

  /** Take the colors of the theme, and draw everything again. */
  repaint() {
    const style = getComputedStyle(this.root);
    const css = this.runs.map((run) => style.getPropertyValue(`--run-${run.color}`));
    const plain = (name) => style.getPropertyValue(name);
    this.colors = { ink: plain("--ink"), muted: plain("--muted"), line: plain("--line"), css };
    if (this.scene) {
      const named = ["ground", "grid", "line", "reference", "drive", "friction", "push"].map((name) => [name, colorOf(style, `--${name}`)]);
      const runs = this.runs.map((run) => colorOf(style, `--run-${run.color}`));
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
      this.fitted = false;
      this.request();
    }).observe(this.root);
  }

  request() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame((now) => {
      this.waiting = false;
      this.step(now);
    });
  }

  /** Return in how many parts the canvas is divided. */
  viewCount() {
    return this.show.ghosts ? 1 : this.runs.length;
  }

  /** Return the parts of the canvas, one for each run or one for all: pixels from the lower left. */
  views(width, height) {
    const count = this.viewCount();
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
    this.scene.draw(this.time, { ...this.show, views: views.map((view) => view.map((length) => length * ratio)) });
    this.grid.textContent = `grid ${Number((100 * this.scene.camera.gridSpacing()).toPrecision(1))} cm`;
  }

  fit(aspect) {
    this.scene.camera.fit(...this.scene.bounds(this.show.follow), aspect);
  }

  placeLabels(views, height) {
    this.labels.forEach((label, i) => {
      const view = views[views.length > 1 ? i : 0];
      label.style.left = `${view[0] + 12}px`;
      label.style.top = `${height - view[1] - view[3] + 10 + (views.length > 1 ? 0 : 44 * i)}px`;
      label.style.maxWidth = `${view[2] - 24}px`;
      label.live.textContent = this.live(this.runs[i]);
    });
  }
}
