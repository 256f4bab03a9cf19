// The page around a picture.

/** Let a button switch the page between the light and the dark theme; the browser's own comes first. */
function switchTheme(button) {
  const root = document.documentElement;
  const preferred = matchMedia("(prefers-color-scheme: dark)");
  const dark = () => (root.dataset.theme || (preferred.matches ? "dark" : "light")) === "dark";
  const show = () => (button.textContent = dark() ? "Light theme" : "Dark theme");
  button.addEventListener("click", () => {
    root.dataset.theme = dark() ? "light" : "dark";
    show();
  });
  preferred.addEventListener("change", show);
  show();
}

for (const button of document.querySelectorAll("[data-ballbot-theme]")) switchTheme(button);
