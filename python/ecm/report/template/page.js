let figures = [];
async function draw() {
  const [specs, views] = (await Promise.all(["packed-figures", "packed-views"].map(unpacked))).map(text => JSON.parse(text));
  if (specs.length || views.length) await run("packed-modules");
  views.forEach((v, i) => document.getElementById("mechanism-" + i)
    .append(modules.scene.workspace(v, v.row, v.columns, v.values, v)));
  if (views.length) modules.selection.onMark(() => views.forEach(v => {
    if (v.link && !marking) markAll(v.link, [...modules.selection.marked]);
  }));
  document.documentElement.dataset.mechanisms = views.length;
  figures = specs.map(spec => modules.figure.figure(spec, {onpick: mark}));
  figures.forEach((f, i) => document.getElementById("figure-" + i).append(f.node));
  for (const f of figures) f.draw();
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
  for (const f of figures) f.select(link, rows);
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
