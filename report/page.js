// The theme, and the choice of the table.
"use strict";

(() => {
  const root = document.documentElement;
  const button = document.getElementById("theme");
  const system = window.matchMedia("(prefers-color-scheme: dark)");

  function setTheme(theme) {
    root.dataset.theme = theme;
    button.textContent = theme === "dark" ? "Light" : "Dark";
    button.setAttribute("aria-label", `Change to ${button.textContent.toLowerCase()} colours`);
    document.dispatchEvent(new Event("themechange"));
  }
  setTheme(system.matches ? "dark" : "light");
  system.addEventListener("change", () => setTheme(system.matches ? "dark" : "light"));
  button.addEventListener("click", () => setTheme(root.dataset.theme === "dark" ? "light" : "dark"));

  const parts = [...document.querySelectorAll("[data-table]")];
  const show = (name) => { for (const part of parts) part.hidden = part.dataset.table !== name; };
  const choices = parts.map((part) => [part.dataset.table, part.dataset.title]);
  window.broadclSegments(document.getElementById("table-choice"), "Which table", choices, "total", show);
  show("total");
})();
