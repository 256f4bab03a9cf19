// Time series under the picture: a panel shows one signal of all logs, and follows the time cursor.

/** How a line of each color is drawn, as in a report's figures (charts.js): distinct in grey, too. */
const LOOKS = {
  blue: { width: 1.5, dash: [] },
  orange: { width: 1.6, dash: [6, 3] },
  violet: { width: 1.7, dash: [2, 3] },
  teal: { width: 1.6, dash: [9, 3, 2, 3] },
};

/** Return a number with three digits that count. */
function shortNumber(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  const digits = size >= 99.95 ? 0 : size >= 9.995 ? 1 : size >= 0.9995 ? 2 : 3;
  const text = value === 0 ? "0" : value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
}

/** Return a number with its unit; a degree sign stands close to it. */
function withUnit(value, unit) {
  return `${shortNumber(value)}${unit === "°" ? "" : " "}${unit}`;
}

/** Return a signal's name and unit, as axes of reports have them: lean [deg]. */
function headingOf(name, runs) {
  const { unit } = runs.flatMap((run) => run.signals).find((signal) => signal.name === name);
  return unit ? `${name} [${unit === "°" ? "deg" : unit}]` : name;
}

/** Time series of one signal of all logs, on uPlot, with the time cursor. */
class Panel {
  /** Make a panel in an element; `seek` is called with the time that the reader points at. */
  constructor(parent, runs, names, chosen, seek) {
    this.runs = runs;
    this.seek = seek;
    this.box = element("section", { class: "panel" }, parent);
    const head = element("div", { class: "panel-head" }, this.box);
    this.select = element("select", { "aria-label": "Signal of this panel" }, head);
    for (const name of names) element("option", { value: name, text: headingOf(name, runs) }, this.select);
    this.select.value = chosen;
    const values = element("span", { class: "readings" }, head);
    this.readings = runs.map((run) => element("output", { class: `reading run-${run.color}` }, values));
    this.place = element("div", { class: "plot", "aria-label": "Time series; drag to move the time cursor" }, this.box);
    this.select.addEventListener("change", () => this.refresh());
    this.refresh();
  }

  /** Return the signal of a log that the panel shows; undefined if the log lacks it. */
  signal(run) {
    return run.signals.find((signal) => signal.name === this.select.value);
  }

  /** Draw everything again, after a change of signal, rows or colors. */
  refresh() {
    this.stale = true;
  }

  /** Return the rows of all logs over one time, three series a log: the middle, the least and the greatest value. */
  data() {
    const tables = this.runs.map((run) => {
      const signal = this.signal(run);
      const known = (value) => (Number.isNaN(value) ? null : value);
      const columns = signal ? signal.columns.map((name) => Array.from(run.columns[name], known)) : [new Array(run.rows).fill(null)];
      const [low, high] = [columns[0], columns[columns.length - 1]];
      const middle = low.map((value, row) => (value === null ? null : (value + high[row]) / 2));
      return [low.map((_, row) => run.start + row * run.interval), middle, low, high];
    });
    return uPlot.join(tables);
  }

  make(width, height) {
    const axis = { stroke: () => this.colors.muted, grid: { stroke: () => this.colors.line, width: 1 }, ticks: { show: false }, font: "11px system-ui, sans-serif" };
    const text = (value) => String(Number(value.toPrecision(6))).replace("-", "−");
    const points = { show: false };
    this.plot = new uPlot(
      {
        width,
        height,
        legend: { show: false },
        cursor: { show: false },
        padding: [8, 10, 0, 0],
        scales: { x: { time: false }, y: { range: (_, low, high) => this.ends(low ?? 0, high ?? 1) } },
        axes: [
          { ...axis, grid: { show: false }, size: 20, gap: 2, values: (_, at) => at.map((value, i) => (i === at.length - 1 ? `${text(value)} s` : text(value))) },
          { ...axis, size: 46, space: 24, values: (_, at) => at.map(text) },
        ],
        series: [{}, ...this.runs.flatMap((run, i) => [{ ...LOOKS[run.color], stroke: () => this.colors.css[i], points }, { width: 0, points }, { width: 0, points }])],
        bands: this.runs.map((_, i) => ({ series: [3 * i + 3, 3 * i + 2], fill: () => `${this.colors.css[i].trim()}4d` })),
      },
      this.data(),
      this.place,
    );
    this.cursor = element("div", { class: "cursor" }, this.plot.over);
    const point = (event) => {
      const share = event.offsetX / this.plot.over.clientWidth;
      this.seek(this.span[0] + Math.min(Math.max(share, 0), 1) * (this.span[1] - this.span[0]));
    };
    this.plot.over.addEventListener("pointerdown", (event) => {
      this.plot.over.setPointerCapture(event.pointerId);
      point(event);
    });
    this.plot.over.addEventListener("pointermove", (event) => {
      if (event.buttons) point(event);
    });
  }

  /** Return the ends of the axis around the values shown. */
  ends(low, high) {
    if (low >= 0 && low < 0.5 * high) return [0, 1.06 * high];
    const room = 0.06 * (high - low) || 0.5;
    return [low - room, high + room];
  }

  /** Draw the panel for a time and a span of times [s]. */
  draw(time, span, colors) {
    this.colors = colors;
    const [width, height] = [this.place.clientWidth, this.place.clientHeight];
    if (!width) return;
    if (!this.plot) this.make(width, height);
    else if (this.plot.width !== width) this.plot.setSize({ width, height });
    if (this.stale) this.plot.setData(this.data(), false);
    if (this.stale || span.join() !== this.span.join()) this.plot.setScale("x", { min: span[0], max: span[1] });
    this.stale = false;
    this.span = span;
    this.cursor.style.left = `${(100 * (time - span[0])) / (span[1] - span[0] || 1)}%`;
    this.runs.forEach((run, i) => {
      const signal = this.signal(run);
      this.readings[i].textContent = !signal || run.ended(time) ? "–" : withUnit(run.reading(signal, time), signal.unit);
    });
  }
}
