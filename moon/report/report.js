"use strict";
// The page: the timeline, and each violation's explanation beside its model's diagram.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const tip = document.getElementById("tip");
  const range = document.getElementById("range");
  const timeline = new Timeline(document.getElementById("canvas"), document.getElementById("scroller"), data);

  timeline.onrange = (from, to) => {
    range.textContent = `${(from / 1e6).toFixed(3)} s to ${(to / 1e6).toFixed(3)} s`;
  };
  timeline.ontip = (words, x, y) => {
    tip.hidden = !words;
    if (!words) return;
    tip.textContent = words;
    tip.style.left = `${Math.max(Math.min(x + 14, window.innerWidth - tip.offsetWidth - 8), 4)}px`;
    tip.style.top = `${Math.min(y + 16, window.innerHeight - tip.offsetHeight - 8)}px`;
  };
  timeline.onselect = (number) => select(number, true);
  for (const button of document.querySelectorAll("[data-do]")) {
    const actions = {
      in: () => timeline.zoom(0.6), out: () => timeline.zoom(1 / 0.6), all: () => timeline.all(),
      previous: () => timeline.step(-1), next: () => timeline.step(1),
    };
    button.addEventListener("click", actions[button.dataset.do]);
  }

  let shown = null;
  function select(number, scroll) {
    const article = document.getElementById(`violation-${number}`);
    const button = document.querySelector(`.violation[data-violation="${number}"]`);
    if (!article || !button) return;
    if (shown) {
      shown.article.hidden = true;
      shown.button.setAttribute("aria-pressed", "false");
      if (shown.figure) shown.figure.hidden = true;
      for (const marked of document.querySelectorAll(".offending")) marked.classList.remove("offending");
    }
    article.hidden = false;
    button.setAttribute("aria-pressed", "true");
    if (scroll) button.scrollIntoView({ block: "nearest" });
    const figure = article.dataset.figure ? document.getElementById(article.dataset.figure) : null;
    const keys = (article.dataset.keys || "").split(" ").filter(Boolean);
    if (figure) {
      figure.hidden = false;
      mark(figure, new Set(keys));
    }
    const none = document.getElementById("no-figure");
    none.hidden = Boolean(figure);
    none.textContent = "There is no diagram for this one.";
    shown = { article, button, figure };
    timeline.select(number);
  }

  // A transition with several targets has an element for each: t3, t3-1, …
  function mark(figure, keys) {
    for (const part of figure.querySelectorAll(".transition, .leaf")) {
      const own = part.id.replace(/^(d\d+-[tl]\d+)-\d+$/, "$1");
      if (keys.has(own)) part.classList.add("offending");
    }
    const short = new Set([...keys].map((key) => key.replace(/^d\d+-/, "")));
    for (const arrow of figure.querySelectorAll(".arrow")) {
      if (arrow.dataset.keys.split(" ").some((key) => short.has(key))) arrow.classList.add("offending");
    }
    const first = figure.querySelector(".offending");
    const wide = figure.querySelector(".wide");
    if (first && wide.scrollWidth > wide.clientWidth) {
      const box = first.getBoundingClientRect();
      wide.scrollLeft += box.left - wide.getBoundingClientRect().left - wide.clientWidth / 3;
    }
  }

  const list = document.querySelector(".list");
  if (list) {
    list.addEventListener("click", (event) => {
      const button = event.target.closest(".violation");
      if (button) select(Number(button.dataset.violation), false);
    });
  }
  timeline.ondraw = () => performance.mark("timeline-painted");
  timeline.draw();
  const follow = () => {
    const asked = /^#violation-(\d+)$/.exec(location.hash);
    if (asked) select(Number(asked[1]), true);
    return asked;
  };
  window.addEventListener("hashchange", follow);
  if (!follow() && list) select(0, false);
})();
