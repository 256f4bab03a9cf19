// Time series under the picture: a panel shows one signal of all logs, and follows the time cursor.

const MARGIN = { left: 46, right: 10, top: 8, bottom: 20 };
/** How a line of each color is drawn, as in a report's figures (charts.js): distinct in grey, too. */
const LOOKS = {
  ink: { width: 2.2, dash: [] },
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

class Panel {
  /** Make a panel in an element; `seek` is called with the time that the reader points at. */
  constructor(parent, runs, names, chosen, seek) {
    this.runs = runs;
    this.box = element("section", { class: "panel" }, parent);
    const head = element("div", { class: "panel-head" }, this.box);
    this.select = element("select", { "aria-label": "Signal of this panel" }, head);
    for (const name of names) element("option", { value: name, text: headingOf(name, runs) }, this.select);
    this.select.value = chosen;
    const values = element("span", { class: "readings" }, head);
    this.readings = runs.map((run) => element("output", { class: `reading run-${run.color}` }, values));
    this.canvas = element("canvas", { class: "plot", "aria-label": "Time series; drag to move the time cursor" }, this.box);
    this.still = document.createElement("canvas");
    this.select.addEventListener("change", () => this.refresh());
    const point = (event) => {
      const share = (event.offsetX - MARGIN.left) / (this.canvas.clientWidth - MARGIN.left - MARGIN.right);
      seek(this.span[0] + Math.min(Math.max(share, 0), 1) * (this.span[1] - this.span[0]));
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      point(event);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (event.buttons) point(event);
    });
    this.refresh();
  }

  /** Return the signal of a log that the panel shows; undefined if the log lacks it. */
  signal(run) {
    return run.signals.find((signal) => signal.name === this.select.value);
  }

  /** Return the columns of a log that the panel shows: one, or the least and the greatest value in each interval. */
  columns(run) {
    const signal = this.signal(run);
    return signal ? signal.columns.map((name) => run.columns[name]) : [];
  }

  /** Forget what was drawn, after a change of signal, size or colors. */
  refresh() {
    this.drawn = "";
  }

  /** Draw the panel for a time and a span of times [s]. */
  draw(time, span, colors) {
    this.span = span;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (!width) return;
    const key = [width, height, ratio, ...span].join();
    if (key !== this.drawn) {
      for (const canvas of [this.canvas, this.still]) [canvas.width, canvas.height] = [width * ratio, height * ratio];
      this.drawStill(ratio, width, height, colors);
      this.drawn = key;
    }
    const context = this.canvas.getContext("2d");
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    context.drawImage(this.still, 0, 0);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const x = this.across(time, width);
    context.strokeStyle = colors.ink;
    context.beginPath();
    context.moveTo(x, MARGIN.top);
    context.lineTo(x, height - MARGIN.bottom);
    context.stroke();
    this.runs.forEach((run, i) => this.read(run, i, time));
  }

  across(time, width) {
    return MARGIN.left + ((time - this.span[0]) / (this.span[1] - this.span[0] || 1)) * (width - MARGIN.left - MARGIN.right);
  }

  /** Show a log's value at a time. */
  read(run, i, time) {
    const signal = this.signal(run);
    if (!signal || run.ended(time)) this.readings[i].textContent = "–";
    else this.readings[i].textContent = withUnit(run.reading(signal, time), signal.unit);
  }

  /** Return the first and the last row of a run within the span, and some more. */
  rows(run, more) {
    const [from, to] = this.span.map((time) => (time - run.start) / run.interval);
    return [Math.max(Math.floor(from) - more, 0), Math.min(Math.ceil(to) + more, run.rows - 1)];
  }

  /** Return the least and the greatest value shown, rounded outward, with the distance of the marks. */
  scale() {
    let [low, high] = [Infinity, -Infinity];
    for (const run of this.runs)
      for (const column of this.columns(run)) {
        const [first, last] = this.rows(run, 0);
        for (let row = first; row <= last; row++) {
          if (column[row] < low) low = column[row];
          if (column[row] > high) high = column[row];
        }
      }
    if (!(low <= high)) return { low: 0, high: 1, step: 1 };
    if (low >= 0 && low < 0.5 * high) low = 0;
    if (high - low < 1e-9) [low, high] = low === 0 ? [0, 1] : [low - 0.5, high + 0.5];
    const step = niceStep((high - low) / 4);
    return { low: step * Math.floor(low / step + 1e-9), high: step * Math.ceil(high / step - 1e-9), step };
  }

  drawStill(ratio, width, height, colors) {
    const context = this.still.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const { low, high, step } = this.scale();
    const inner = height - MARGIN.top - MARGIN.bottom;
    const up = (value) => MARGIN.top + inner * (1 - (value - low) / (high - low));
    context.font = "11px system-ui, sans-serif";
    context.fillStyle = colors.muted;
    context.strokeStyle = colors.line;
    context.lineWidth = 1;
    context.textAlign = "right";
    context.textBaseline = "middle";
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    for (let value = low; value <= high + 0.001 * step; value += step) {
      const y = Math.round(up(value)) + 0.5;
      this.stroke(context, [[MARGIN.left, y], [width - MARGIN.right, y]]);
      context.fillText(value.toFixed(digits).replace("-", "−"), MARGIN.left - 6, y);
    }
    context.textAlign = "center";
    const [from, to] = this.span;
    const tick = niceStep((to - from) / Math.max(width / 70, 2) || 1);
    for (let t = tick * Math.ceil(from / tick - 1e-9); t <= to + 1e-9; t += tick) {
      const text = t.toFixed(Math.max(0, -Math.floor(Math.log10(tick) + 1e-9)));
      context.fillText(t + tick > to ? `${text} s` : text, Math.min(this.across(t, width), width - 14), height - 8);
    }
    context.save();
    context.beginPath();
    context.rect(MARGIN.left, 0, width - MARGIN.left - MARGIN.right, height);
    context.clip();
    this.runs.forEach((run, i) => this.drawLine(context, run, i, up, width, colors));
    context.restore();
  }

  stroke(context, points) {
    context.beginPath();
    points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.stroke();
  }

  /** Draw one log: the band between the least and the greatest value at each dot of the screen, and the middle of it. */
  drawLine(context, run, i, up, width, colors) {
    const columns = this.columns(run);
    if (!columns.length) return;
    const look = LOOKS[run.color];
    context.strokeStyle = context.fillStyle = colors.css[i];
    context.lineWidth = look.width;
    context.lineJoin = "round";
    const [first, last] = this.rows(run, 1);
    const rows = Math.max(1, Math.floor((last - first) / width));
    let [middle, upper, lower] = [[], [], []];
    const flush = () => {
      context.globalAlpha = 0.3;
      context.beginPath();
      for (const [x, y] of [...upper, ...lower.reverse()]) context.lineTo(x, y);
      context.fill();
      context.globalAlpha = 1;
      context.setLineDash(look.dash);
      if (middle.length) this.stroke(context, middle);
      context.setLineDash([]);
      [middle, upper, lower] = [[], [], []];
    };
    for (let row = first; row <= last; row += rows) {
      let [low, high] = [Infinity, -Infinity];
      for (const column of columns)
        for (let k = row; k < Math.min(row + rows, last + 1); k++) {
          if (column[k] < low) low = column[k];
          if (column[k] > high) high = column[k];
        }
      const x = this.across(run.start + row * run.interval, width);
      if (low > high) flush();
      else {
        middle.push([x, up((low + high) / 2)]);
        upper.push([x, up(high)]);
        lower.push([x, up(low)]);
      }
    }
    flush();
  }
}
