// What a computation found, read from a file beside the page again and again until it is done.

class ResultBox {
  constructor(box) {
    this.box = box;
    this.read();
  }

  /** Load the file: it calls ballbotResult with its state. */
  read() {
    window.ballbotResult = (state) => this.show(state);
    const script = element("script", { src: `${this.box.dataset.ballbotResult}?${Date.now()}` }, document.head);
    const end = () => {
      script.remove();
      if (!this.done) setTimeout(() => this.read(), 700);
    };
    script.addEventListener("load", end);
    script.addEventListener("error", end);
  }

  show(state) {
    const text = JSON.stringify(state);
    if (text === this.shown) return;
    this.shown = text;
    this.done = state.share === null;
    this.box.replaceChildren();
    element("h2", { text: state.heading }, this.box);
    if (!this.done) element("progress", { value: state.share, max: 1, "aria-label": "Share that is done" }, this.box);
    for (const sentence of state.sentences) element("p", { text: sentence }, this.box);
    if (state.columns.length) this.table(state);
    for (const [href, text] of state.links) element("a", { href, text }, element("p", {}, this.box));
  }

  table({ columns, rows, caption }) {
    if (caption) element("p", { class: "caption", text: caption }, this.box);
    const table = element("table", {}, element("div", { class: "scroll" }, this.box));
    const head = element("tr", {}, element("thead", {}, table));
    for (const one of columns) element("th", { text: one, scope: "col" }, head);
    const body = element("tbody", {}, table);
    for (const row of rows) {
      const line = element("tr", {}, body);
      for (const cell of row) element("td", { text: cell }, line);
    }
  }
}

for (const box of document.querySelectorAll("[data-ballbot-result]")) new ResultBox(box);
