// Time series of a report on uPlot: panels over one time, which zoom together and show their values under the pointer.

const LOOKS = {
  measured: { color: "--ink", width: 1.7, dash: [], marker: null },
  first: { color: "--blue", width: 1.5, dash: [], marker: "circle" },
  second: { color: "--orange", width: 1.6, dash: [8, 5], marker: "square" },
  third: { color: "--green", width: 1.6, dash: [9, 4, 2, 4], marker: "triangle" },
  fourth: { color: "--violet", width: 1.7, dash: [2, 4], marker: "diamond" },
  fifth: { color: "--yellow", width: 1.6, dash: [14, 4], marker: "cross" },
  sixth: { color: "--ink", width: 1.4, dash: [4, 4], marker: null },
  reference: { color: "--pale", width: 4, dash: [], marker: null },
  quiet: { color: "--muted", width: 0.7, dash: [], marker: null },
};
const MARKER_EVERY = 130; // dots of the screen
const FONT = '12px system-ui, "Segoe UI", "Liberation Sans", sans-serif';
const ZOOM = 2.5;

/** Return a number with four digits that count. */
function shown(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = Number(value.toPrecision(4));
  return String(Math.abs(text) >= 1e-4 || text === 0 ? text : value.toExponential(1)).replace("-", "−");
}

/** Draw a marker of a line around a place. */
function drawMarker(context, kind, x, y, size) {
  context.beginPath();
  if (kind === "circle") context.arc(x, y, 0.9 * size, 0, 2 * Math.PI);
  else if (kind === "cross") {
    for (const [dx, dy] of [[-1, -1], [1, 1], [0, 0], [1, -1], [-1, 1]]) context.lineTo(x + dx * size, y + dy * size);
  } else if (kind === "square") context.rect(x - 0.85 * size, y - 0.85 * size, 1.7 * size, 1.7 * size);
  else {
    const corners = kind === "triangle" ? [[0, -1.2], [1.1, 0.9], [-1.1, 0.9]] : [[0, -1.3], [1.2, 0], [0, 1.3], [-1.2, 0]];
    corners.forEach(([dx, dy], i) => (i ? context.lineTo : context.moveTo).call(context, x + dx * size, y + dy * size));
    context.closePath();
  }
  context.fill();
  context.stroke();
}

class Chart {
  /** Make the panels in an element from its data. */
  constructor(root, data) {
    this.root = root;
    this.data = data;
    this.t = unpacked(data.t);
    this.hidden = new Set();
    this.plots = [];
    this.readings = [];
    this.gutter = 42;
    root.replaceChildren();
    root.classList.add("chart");
    this.makeBar();
    data.panels.forEach((panel, i) => this.makePanel(panel, i));
    this.alignPanels();
    this.watch();
  }

  color(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  }

  /** Make the legend, whose entries show and hide lines, and the buttons that zoom. */
  makeBar() {
    const bar = element("div", { class: "chart-bar" }, this.root);
    const legend = element("div", { class: "legend" }, bar);
    const seen = new Set();
    for (const line of this.data.panels.flatMap((panel) => (panel.lines.length > 1 ? panel.lines : []))) {
      const key = line.look + line.name;
      if (seen.has(key)) continue;
      seen.add(key);
      const entry = element("button", { type: "button", "aria-pressed": "true", title: "Show or hide" }, legend);
      entry.append(this.swatch(LOOKS[line.look]), line.name);
      entry.addEventListener("click", () => this.toggle(key, entry));
    }
    if (this.data.shaded.length && this.data.shade) element("span", { class: "shade-key", text: this.data.shade }, legend);
    if (this.data.level) element("span", { class: "level-key", text: this.data.level }, legend);
    const zoom = element("div", { class: "zoom" }, bar);
    const button = (text, label, act) =>
      element("button", { type: "button", text, "aria-label": label, title: label }, zoom).addEventListener("click", act);
    button("+", "Zoom in", () => this.scale(1 / ZOOM));
    button("−", "Zoom out", () => this.scale(ZOOM));
    button("‹", "Earlier", () => this.shift(-0.5));
    button("›", "Later", () => this.shift(0.5));
    button("All", "Show the whole time", () => this.show(...this.whole()));
    button("CSV", "Download the data", () => this.download());
  }

  /** Save the lines as a table, a column each. */
  download() {
    const columns = [["time_s", this.t]];
    for (const panel of this.data.panels)
      for (const line of panel.lines) columns.push([`"${panel.label}: ${line.name}"`, unpacked(line.values)]);
    const rows = [columns.map(([name]) => name).join(",")];
    for (let i = 0; i < this.t.length; i++)
      rows.push(columns.map(([, one]) => (Number.isNaN(one[i]) ? "" : Number(one[i].toPrecision(6)))).join(","));
    const link = element("a", { href: URL.createObjectURL(new Blob([rows.join("\n")])), download: `${this.root.dataset.ballbotChart}.csv` });
    link.click();
    URL.revokeObjectURL(link.href);
  }

  swatch(look) {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [68, 24];
    canvas.className = "swatch";
    canvas.draw = () => {
      const context = canvas.getContext("2d");
      context.setTransform(2, 0, 0, 2, 0, 0);
      context.clearRect(0, 0, 34, 12);
      context.strokeStyle = context.fillStyle = this.color(look.color);
      context.lineWidth = Math.max(look.width, 1.2);
      context.setLineDash(look.dash);
      context.beginPath();
      context.moveTo(0, 6);
      context.lineTo(34, 6);
      context.stroke();
      context.setLineDash([]);
      if (look.marker) {
        context.fillStyle = this.color("--page");
        drawMarker(context, look.marker, 17, 6, 3.4);
      }
    };
    canvas.draw();
    return canvas;
  }

  toggle(key, entry) {
    if (this.hidden.has(key)) this.hidden.delete(key);
    else this.hidden.add(key);
    entry.setAttribute("aria-pressed", String(!this.hidden.has(key)));
    this.plots.forEach((plot, i) =>
      this.data.panels[i].lines.forEach((line, k) => {
        if (line.look + line.name === key) plot.setSeries(k + 1, { show: !this.hidden.has(key) });
      }),
    );
  }

  makePanel(panel, place) {
    const box = element("div", { class: "panel" }, this.root);
    const head = element("div", { class: "panel-head" }, box);
    element("span", { class: "panel-label", text: panel.label }, head);
    this.readings.push(element("output", { class: "reading" }, head));
    const values = panel.lines.map((line) => Array.from(unpacked(line.values), (one) => (Number.isNaN(one) ? null : one)));
    const last = place === this.data.panels.length - 1;
    const axis = () => ({
      stroke: () => this.color("--muted"),
      grid: { stroke: () => this.color("--line"), width: 1 },
      ticks: { stroke: () => this.color("--line"), width: 1, size: 4 },
      font: FONT,
    });
    const number = (_, splits) => splits.map((one) => (one === null ? "" : String(Number(one.toPrecision(6))).replace("-", "−")));
    const plot = new uPlot(
      {
        width: this.width(),
        height: this.height(last),
        pxAlign: false,
        legend: { show: false },
        padding: [6, 10, 0, 0],
        scales: { x: { time: false }, y: { range: (_, low, high) => this.span(panel, low, high) } },
        axes: [
          { ...axis(), size: last ? 44 : 10, values: last ? number : () => [], label: last ? this.data.across : undefined, labelFont: FONT, labelSize: 18, space: 60 },
          { ...axis(), size: (_, shown) => this.gutterFor(shown), space: 18, values: number },
        ],
        series: [{}, ...panel.lines.map((line) => this.series(line))],
        cursor: {
          points: { show: false },
          drag: { x: true, y: false, setScale: false },
          sync: { key: this.key(), setSeries: false, scales: ["x", null] },
        },
        hooks: {
          drawClear: [(u) => this.drawShades(u)],
          drawSeries: [(u, k) => this.drawMarkers(u, k, panel)],
          draw: [(u) => this.drawLevels(u, panel)],
          setCursor: [(u) => this.read(u, panel, place, values)],
          setSelect: [(u) => this.select(u)],
        },
      },
      [Array.from(this.t), ...values],
      box,
    );
    plot.over.addEventListener("dblclick", () => this.show(...this.whole()));
    this.plots.push(plot);
  }

  /** Return the width beside the panels, which is that of the longest number so far. */
  gutterFor(shown) {
    const longest = Math.max(0, ...(shown || []).map((one) => one.length));
    const needed = 14 + 7 * longest;
    if (needed > this.gutter) {
      this.gutter = needed;
      if (this.plots.length) requestAnimationFrame(() => this.alignPanels());
    }
    return this.gutter;
  }

  alignPanels() {
    for (const plot of this.plots) plot.redraw(false, true);
  }

  /** Return how uPlot draws a line; its color follows the theme. */
  series(line) {
    const look = LOOKS[line.look];
    return { stroke: () => this.color(look.color), width: look.width, dash: look.dash, points: { show: false }, spanGaps: false };
  }

  key() {
    this.name = this.name || `chart-${Chart.count++}`;
    return this.name;
  }

  width() {
    return Math.max(this.root.clientWidth, 200);
  }

  height(last) {
    return (this.data.panels.length > 4 ? 120 : this.data.panels.length > 1 ? 150 : 220) + (last ? 34 : 0);
  }

  /** Return the ends of a panel's axis around its values. */
  span(panel, low, high) {
    if (panel.ends) return panel.ends;
    let [a, b] = [low ?? 0, high ?? 1];
    if (panel.levels.length) [a, b] = [Math.min(a, ...panel.levels), Math.max(b, ...panel.levels)];
    if (panel.from_zero) a = Math.min(0, a);
    if (b - a < 1e-12) [a, b] = [a - 0.5, b + 0.5];
    const room = 0.06 * (b - a);
    return [panel.from_zero && a === 0 ? 0 : a - room, b + room];
  }

  /** Draw within a panel's axes. */
  within(u, draw) {
    const { left, top, width, height } = u.bbox;
    u.ctx.save();
    u.ctx.beginPath();
    u.ctx.rect(left, top, width, height);
    u.ctx.clip();
    draw(u.ctx);
    u.ctx.restore();
  }

  drawShades(u) {
    this.within(u, (context) => {
      context.fillStyle = this.color("--band");
      for (const [start, end] of this.data.shaded) {
        const [a, b] = [u.valToPos(start, "x", true), u.valToPos(end, "x", true)];
        context.fillRect(a, u.bbox.top, b - a, u.bbox.height);
      }
    });
  }

  drawLevels(u, panel) {
    this.within(u, (context) => {
      context.strokeStyle = this.color("--ink");
      context.lineWidth = devicePixelRatio;
      context.setLineDash([3 * devicePixelRatio, 3 * devicePixelRatio]);
      for (const level of panel.levels) {
        const y = u.valToPos(level, "y", true);
        context.beginPath();
        context.moveTo(u.bbox.left, y);
        context.lineTo(u.bbox.left + u.bbox.width, y);
        context.stroke();
      }
    });
  }

  /** Draw a marker on a line now and then, so that it is known without its color. */
  drawMarkers(u, k, panel) {
    const look = LOOKS[panel.lines[k - 1].look];
    if (!look.marker || !u.series[k].show) return;
    const ratio = devicePixelRatio;
    this.within(u, (context) => {
      context.strokeStyle = this.color(look.color);
      context.fillStyle = this.color("--page");
      context.lineWidth = 1.3 * ratio;
      for (let x = 18 + 31 * (k - 1); x < u.bbox.width / ratio; x += MARKER_EVERY) {
        const row = u.valToIdx(u.posToVal(x, "x"));
        const value = u.data[k][row];
        if (value !== null && value !== undefined)
          drawMarker(context, look.marker, u.valToPos(u.data[0][row], "x", true), u.valToPos(value, "y", true), 3.2 * ratio);
      }
    });
  }

  /** Show the values under the pointer beside a panel's label. */
  read(u, panel, place, values) {
    const output = this.readings[place];
    const row = u.cursor.idx;
    output.replaceChildren();
    if (row === null || row === undefined || u.cursor.left < 0) return;
    element("span", { text: `${shown(this.t[row])} s` }, output);
    panel.lines.forEach((line, k) => {
      if (this.hidden.has(line.look + line.name)) return;
      const one = element("span", { text: shown(values[k][row]), title: line.name }, output);
      one.style.color = this.color(LOOKS[line.look].color === "--pale" ? "--muted" : LOOKS[line.look].color);
    });
  }

  select(u) {
    if (u.select.width < 4) return;
    const [start, end] = [u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")];
    for (const plot of this.plots) plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.show(start, end);
  }

  whole() {
    return [this.t[0], this.t[this.t.length - 1]];
  }

  range() {
    const { min, max } = this.plots[0].scales.x;
    return [min, max];
  }

  show(start, end) {
    const [first, last] = this.whole();
    const [min, max] = [Math.max(first, start), Math.min(last, end)];
    if (max > min) for (const plot of this.plots) plot.setScale("x", { min, max });
  }

  scale(factor) {
    const [start, end] = this.range();
    const [middle, half] = [(start + end) / 2, (factor * (end - start)) / 2];
    this.show(middle - half, middle + half);
  }

  shift(share) {
    const [start, end] = this.range();
    const [first, last] = this.whole();
    const step = Math.min(Math.max(share * (end - start), first - start), last - end);
    this.show(start + step, end + step);
  }

  /** Draw again in the theme's colors. */
  repaint() {
    for (const canvas of this.root.querySelectorAll(".swatch")) canvas.draw();
    for (const plot of this.plots) plot.redraw(false, true);
  }

  watch() {
    new ResizeObserver(() => {
      const width = this.width();
      this.plots.forEach((plot, i) => {
        if (plot.width !== width) plot.setSize({ width, height: this.height(i === this.plots.length - 1) });
      });
    }).observe(this.root);
  }
}
Chart.count = 0;

const charts = [];
for (const root of document.querySelectorAll("[data-ballbot-chart]"))
  charts.push(new Chart(root, JSON.parse(document.getElementById(root.dataset.ballbotChart).textContent)));
const repaint = () => charts.forEach((chart) => chart.repaint());
