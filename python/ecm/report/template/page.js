let figures = [], packedFigures = "";
// Colours of figures that a dark page replaces by its own.
const OWN = {"#1c2430": "--ink", "#000000": "--ink", "white": "--paper", "#ffffff": "--paper",
  "#e4e8ed": "--line", "#c4ccd6": "--line", "#8a94a2": "--soft", "#0072b2": "--point",
  "#b3261e": "--bad", "#4393c3": "--low", "#e58368": "#9c4a2e"};
const dark = matchMedia("(prefers-color-scheme: dark)");
const finger = matchMedia("(pointer: coarse)").matches;  // a finger scrolls and taps
function coloured() {
  const style = getComputedStyle(document.documentElement);
  const own = name => name.startsWith("--") ? style.getPropertyValue(name).trim() : name;
  const found = JSON.parse(packedFigures, (_, value) => dark.matches && typeof value === "string"
    && Object.hasOwn(OWN, value) ? own(OWN[value]) : value);
  const page = {paper_bgcolor: own("--paper"), plot_bgcolor: own("--paper"),
    font: {color: own("--ink")}, ...(finger ? {dragmode: false} : {})};
  return found.map(f => ({...f, layout: {...page, ...f.layout}}));
}
async function drawMechanisms() {
  const views = JSON.parse(await unpacked("packed-views"));
  if (!views.length) return;
  await run("packed-space");
  views.forEach((v, i) => document.getElementById("mechanism-" + i)
    .append(modules.scene.workspace(v, v.row, v.columns, v.values, v)));
  modules.selection.onMark(() => views.forEach(v => {
    if (v.link && !marking) markAll(v.link, [...modules.selection.marked]);
  }));
  document.documentElement.dataset.mechanisms = views.length;
}
async function draw() {
  await drawMechanisms();
  await run("packed-plotly");
  packedFigures = await unpacked("packed-figures");
  figures = coloured();
  figures.forEach((f, i) => {
    Plotly.newPlot("figure-" + i, f.data, f.layout,
      {responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"]});
    document.getElementById("figure-" + i).on("plotly_click", e => {
      const trace = e.points[0].data;
      if (trace.meta) mark(trace.meta, e.points[0].customdata);
    });
  });
  dark.addEventListener("change", () => {
    figures = coloured();
    figures.forEach((f, i) => Plotly.react("figure-" + i, f.data, f.layout));
    markAll("", []);
  });
  document.documentElement.dataset.figures = figures.length;
}
// A row marked anywhere is marked in every figure, table and mechanism of the same link.
let marked = "", marking = false;
function mark(link, row) {
  markAll(link, marked === link + row ? [] : [row]);
}
function markAll(link, rows) {
  marked = rows.length ? link + rows.join(",") : "";
  document.documentElement.dataset.marked = rows.join(",");
  const chosen = new Set(rows.map(String));
  figures.forEach((f, i) => f.data.forEach((trace, k) => {
    if (trace.meta !== link) return;
    const at = trace.customdata.flatMap((r, j) => chosen.has(String(r)) ? [j] : []);
    Plotly.restyle("figure-" + i, {selectedpoints: [marked ? at : null]}, [k]);
  }));
  document.querySelectorAll("tr[data-row]").forEach(tr => tr.classList.toggle("marked",
    tr.dataset.link === link && chosen.has(tr.dataset.row)));
  if (typeof modules === "undefined") return;
  marking = true;
  modules.selection.mark(rows.map(Number));
  marking = false;
}
document.querySelectorAll("tr[data-row]").forEach(tr => {
  tr.addEventListener("click", () => mark(tr.dataset.link, tr.dataset.row));
  tr.addEventListener("keydown", e => { if (e.key === "Enter") tr.click(); });
});
const drawn = draw().catch(e => {
  document.documentElement.dataset.error = e.message;
  document.querySelectorAll("main figure div[id]:empty").forEach(div => {
    div.textContent = "This figure needs a browser of 2023 or later: " + e.message;
  });
});
