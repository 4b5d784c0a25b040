"use strict";
// Draws every chart from the spec inside it, and shows one run at a time, in charts and tables alike.
const theme = {
  font: getComputedStyle(document.body).fontFamily,
  background: "transparent",
  title: { color: "currentColor", fontSize: 14, anchor: "start" },
  axis: { labelColor: "currentColor", titleColor: "currentColor", tickColor: "currentColor", domainColor: "currentColor",
    gridColor: "currentColor", gridOpacity: 0.12, labelFontSize: 11, titleFontSize: 12, titleFontWeight: 600 },
  header: { labelColor: "currentColor", titleColor: "currentColor", labelFontSize: 12 },
  legend: { labelColor: "currentColor", titleColor: "currentColor", labelFontSize: 11, titleFontSize: 12 },
  text: { color: "currentColor" },
  view: { stroke: "currentColor", strokeOpacity: 0.15 },
};
const actions = { export: true, source: false, compiled: false, editor: false };
const charts = [...document.querySelectorAll(".chart")].map((place) => {
  const spec = JSON.parse(place.querySelector("script").textContent);
  return vegaEmbed(place, spec, { config: theme, actions, renderer: "svg" }).then((drawn) => drawn.view);
});

const run = document.getElementById("run");
run.addEventListener("change", async () => {
  for (const part of document.querySelectorAll(".for-run")) part.hidden = part.dataset.run !== run.value;
  for (const view of await Promise.all(charts)) {
    if ("run" in view.getState().signals) view.signal("run", run.value).runAsync();
  }
});
