"use strict";
// Draws every chart from the spec inside it.
const theme = {
  font: getComputedStyle(document.body).fontFamily,
  background: "transparent",
  title: { color: "currentColor", fontSize: 14, anchor: "start" },
  axis: { labelColor: "currentColor", titleColor: "currentColor", tickColor: "currentColor", domainColor: "currentColor",
    gridColor: "currentColor", gridOpacity: 0.12, labelFontSize: 11, labelLimit: 220, titleFontSize: 12, titleFontWeight: 600 },
  header: { labelColor: "currentColor", titleColor: "currentColor", labelFontSize: 12 },
  legend: { labelColor: "currentColor", titleColor: "currentColor", labelFontSize: 11, titleFontSize: 12, labelLimit: 220 },
  rule: { color: "currentColor" },
  view: { stroke: "currentColor", strokeOpacity: 0.15 },
};
const actions = { export: true, source: false, compiled: false, editor: false };
for (const place of document.querySelectorAll(".chart")) {
  vegaEmbed(place, JSON.parse(place.querySelector("script").textContent), { config: theme, actions, renderer: "svg" });
}
