// Light and dark for every page, with one button. SPDX-License-Identifier: BSD-3-Clause
"use strict";
(() => {
  const root = document.documentElement;
  const button = document.getElementById("theme");
  const system = window.matchMedia("(prefers-color-scheme: dark)");
  let chosen = null;
  try {
    chosen = localStorage.getItem("tokid-theme");
  } catch { /* storage may be closed to files */ }

  const current = () => chosen || (system.matches ? "dark" : "light");
  let printing = false;

  function apply() {
    const theme = printing ? "light" : current();
    if (root.dataset.theme === theme && root.dataset.printing === String(printing)) return;
    root.dataset.printing = String(printing);
    root.dataset.theme = theme;
    button.textContent = theme === "dark" ? "Light" : "Dark";
    button.setAttribute("aria-label", `Switch to ${theme === "dark" ? "light" : "dark"} colours`);
    document.dispatchEvent(new Event("tokid:theme"));
  }

  button.hidden = false;
  button.addEventListener("click", () => {
    chosen = current() === "dark" ? "light" : "dark";
    try {
      localStorage.setItem("tokid-theme", chosen);
    } catch { /* then it holds for this page only */ }
    apply();
  });
  system.addEventListener("change", apply);
  // Pages are printed in the light colours.
  const paper = window.matchMedia("print");
  const print = on => { printing = on; apply(); };
  paper.addEventListener("change", event => print(event.matches));
  window.addEventListener("beforeprint", () => print(true));
  window.addEventListener("afterprint", () => print(false));
  printing = paper.matches;
  apply();

  // The keyboard reaches only those tables that can be scrolled.
  const scrolls = [...document.querySelectorAll(".scroll")];
  const reachable = () => {
    for (const scroll of scrolls)
      scroll.scrollWidth > scroll.clientWidth ? scroll.setAttribute("tabindex", "0") : scroll.removeAttribute("tabindex");
  };
  if ("ResizeObserver" in window) {
    const sizes = new ResizeObserver(reachable);
    for (const scroll of scrolls) sizes.observe(scroll);
  }
  reachable();

  // The navigation marks the section that is on the screen.
  const links = new Map([...document.querySelectorAll("nav a")].map(a => [a.hash.slice(1), a]));
  if (links.size && "IntersectionObserver" in window) {
    const seen = new Set();
    const watch = new IntersectionObserver(entries => {
      for (const entry of entries) entry.isIntersecting ? seen.add(entry.target.id) : seen.delete(entry.target.id);
      const first = [...links.keys()].find(id => seen.has(id));
      for (const [id, link] of links) id === first ? link.setAttribute("aria-current", "true") : link.removeAttribute("aria-current");
    }, {rootMargin: "-80px 0px -50% 0px"});
    for (const id of links.keys()) {
      const section = document.getElementById(id);
      if (section) watch.observe(section);
    }
  }
})();
