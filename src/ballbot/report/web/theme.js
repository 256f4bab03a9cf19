// What every page does: its theme is the browser's at first, then as the reader chooses, and light on paper; a narrow
// page folds tables, which paper shows.

const root = document.documentElement;
const prefersDark = matchMedia("(prefers-color-scheme: dark)");
const isDark = () => (root.dataset.theme || (prefersDark.matches ? "dark" : "light")) === "dark";

for (const button of document.querySelectorAll("[data-report-theme]")) {
  const name = () => (button.textContent = isDark() ? "Light theme" : "Dark theme");
  button.addEventListener("click", () => {
    root.dataset.theme = isDark() ? "light" : "dark";
    name();
  });
  prefersDark.addEventListener("change", name);
  name();
}
if (typeof repaint === "function") {
  prefersDark.addEventListener("change", repaint);
  new MutationObserver(repaint).observe(root, { attributeFilter: ["data-theme"] });
}

/** Mark what can be scrolled further, so that it shows that there is more. */
for (const box of document.querySelectorAll(".scroll")) {
  const mark = () => box.classList.toggle("more", box.scrollLeft + box.clientWidth < box.scrollWidth - 2);
  box.addEventListener("scroll", mark, { passive: true });
  new ResizeObserver(mark).observe(box);
}
/** Fold on a narrow page what may be folded there; a wide one has nothing to open it with. */
const isNarrow = matchMedia("(max-width: 40rem)");
const fold = (closed) => {
  for (const one of document.querySelectorAll("[data-report-fold]")) one.open = !closed;
};
isNarrow.addEventListener("change", () => fold(isNarrow.matches));
fold(isNarrow.matches);

let before;
addEventListener("beforeprint", () => {
  fold(false);
  before = root.dataset.theme;
  root.dataset.theme = "light";
  if (typeof repaint === "function") repaint();
});
addEventListener("afterprint", () => {
  if (before) root.dataset.theme = before;
  else delete root.dataset.theme;
});
