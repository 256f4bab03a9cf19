// Pages within a page follow the theme that its reader chose; their own buttons for it go.

function follow(frame) {
  const root = frame.contentDocument?.documentElement; // null where the site is read from files
  if (!root) return;
  const theme = document.body.dataset.theme;
  if (theme === "light" || theme === "dark") root.dataset.theme = theme;
  else delete root.dataset.theme;
  root.querySelector("[data-ballbot-theme]")?.remove();
}

const frames = [...document.querySelectorAll("iframe.made")];
for (const frame of frames) {
  frame.addEventListener("load", () => follow(frame));
  follow(frame);
}
new MutationObserver(() => frames.forEach(follow)).observe(document.body, { attributeFilter: ["data-theme"] });
