// The replay of logs: picture, controls, panels; one for each element with the attribute data-ballbot-replay.

const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 4];
const SPANS = [0, 20, 5, 1];
const DEFAULT_PANELS = ["distance from the reference", "lean", "largest wheel torque"];

class Replay extends View {
  constructor(root, data) {
    const runs = data.runs.map((run) => new Run(run));
    super(root, data, runs, { ghosts: data.layout === "ghosts", arrows: true, follow: false });
    this.duration = Math.max(...runs.map((run) => run.duration));
    this.playing = false;
    this.speed = 1;
    this.window = 0;
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

  makeControls() {
    const bar = element("div", { class: "controls" }, this.root);
    this.button = element("button", { type: "button", class: "play" }, bar);
    this.button.addEventListener("click", () => (this.playing ? this.pause() : this.play()));
    const range = { type: "range", min: 0, max: this.duration, step: "any", value: 0, class: "time" };
    this.slider = element("input", { ...range, "aria-label": "Time" }, bar);
    this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
    this.clock = element("output", { class: "clock" }, bar);
    const speeds = SPEEDS.map((speed) => [String(speed), speed === 1 ? "1× speed" : `${speed}×`]);
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
    const spans = SPANS.map((span) => [String(span), span ? `Plots: ${span} s` : "Plots: whole log"]);
    this.choice(options, "Time span of the plots", spans, "0", (value) => (this.window = Number(value)));
    this.root.addEventListener("keydown", (event) => this.press(event));
    if (this.data.autoplay) document.addEventListener("keydown", (event) => event.target === document.body && this.press(event));
    this.pause();
  }

  makePanels() {
    const names = [...new Set(this.runs.flatMap((run) => run.signals.map((signal) => signal.name)))];
    const chosen = [...DEFAULT_PANELS.filter((name) => names.includes(name)), ...names].slice(0, 3);
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

  live(run) {
    if (!this.duration) return "";
    if (run.ended(this.time)) return `log ends at ${run.duration.toFixed(1)} s`;
    const names = ["distance from the reference", "lean"];
    return run.signals
      .filter((signal) => names.includes(signal.name))
      .map((signal) => `${signal.short} ${withUnit(run.reading(signal, this.time), signal.unit)}`)
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

for (const root of document.querySelectorAll("[data-ballbot-replay]"))
  new Replay(root, JSON.parse(document.getElementById(root.dataset.ballbotReplay).textContent));
