// What a report does: its charts follow the theme, which is light on paper; a table is sorted by the column whose heading
// is pressed; paper has all that is folded.

const root = document.documentElement;
const prefersDark = matchMedia("(prefers-color-scheme: dark)");
if (typeof repaint === "function") {
  prefersDark.addEventListener("change", repaint);
  new MutationObserver(repaint).observe(root, { attributeFilter: ["data-theme"] });
}

/** Return what a row is sorted by: the first number of a cell, or its text. */
function sortKey(row, column) {
  const text = row.cells[column].textContent.trim();
  const number = parseFloat(text.replace(/^[^\d.+−-]*/, "").replace("−", "-").replace(/,(?=\d)/g, ""));
  return { text, number: Number.isNaN(number) ? Infinity : number };
}

function sortTable(heading) {
  const table = heading.closest("table");
  const down = heading.getAttribute("aria-sort") === "ascending";
  for (const one of table.querySelectorAll("[aria-sort]")) one.removeAttribute("aria-sort");
  heading.setAttribute("aria-sort", down ? "descending" : "ascending");
  const numeric = !heading.classList.contains("text") && heading.cellIndex > 0;
  const body = table.tBodies[0];
  const keyed = [...body.rows].map((row) => ({ row, ...sortKey(row, heading.cellIndex) }));
  const order = (a, b) => (numeric ? a.number - b.number || 0 : a.text.localeCompare(b.text, undefined, { numeric: true }));
  keyed.sort((a, b) => (down ? -1 : 1) * order(a, b));
  body.append(...keyed.map((one) => one.row));
}

for (const heading of document.querySelectorAll("[data-ballbot-sort]")) {
  heading.tabIndex = 0;
  heading.title = "Sort by this column";
  heading.addEventListener("click", () => sortTable(heading));
  heading.addEventListener("keydown", (event) => {
    if (event.key === "Enter") sortTable(heading);
  });
}

let before;
addEventListener("beforeprint", () => {
  for (const one of document.querySelectorAll("details")) one.open = true;
  before = root.dataset.theme;
  root.dataset.theme = "light";
  if (typeof repaint === "function") repaint();
});
addEventListener("afterprint", () => {
  if (before) root.dataset.theme = before;
  else delete root.dataset.theme;
});
