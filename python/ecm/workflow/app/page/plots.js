// Figures by plotly, in the colours of the page.

let loading = null;

export function plotly() {
  loading ??= new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = "/plotly.js";
    script.onload = () => resolve(window.Plotly);
    script.onerror = () => reject(new Error("the figures could not be loaded"));
    document.head.append(script);
  });
  return loading;
}

const colour = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export const axis = (title, more = {}) => ({
  title: {text: title, standoff: 6}, gridcolor: colour("--line"), linecolor: colour("--soft"),
  zeroline: false, showline: true, ticks: "outside", ...more,
});

export function theme(layout = {}) {
  return {
    font: {family: "system-ui, DejaVu Sans, Arial, sans-serif", size: 13, color: colour("--ink")},
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    margin: {l: 60, r: 16, t: 34, b: 46}, showlegend: false, ...layout,
  };
}

export const colours = () => ({
  mark: colour("--mark"), second: colour("--second"), ink: colour("--ink"),
  soft: colour("--soft"), line: colour("--line"),
});

export async function draw(node, data, layout) {
  const library = await plotly();
  await library.react(node, data, theme(layout), {responsive: true, displaylogo: false});
  return node;
}

// Poses as points of the top frame, beside the undeformed body and the frames.
export function scene(view, values, title, marked = new Set()) {
  const {mark, second, soft} = colours();
  const mm = values => values.map(v => v * 1e3);
  const data = [];
  if (view.body) {
    const [x, y, z] = view.body.points_m.map(mm);
    const [i, j, k] = view.body.triangles;
    data.push({type: "mesh3d", x, y, z, i, j, k, color: soft, opacity: 0.25, hoverinfo: "skip",
      name: "undeformed body"});
  }
  for (const frame of view.frames) {
    frame.axes.forEach((direction, n) => {
      const from = mm(frame.origin_m), to = from.map((v, m) => v + 20 * direction[m]);
      data.push({type: "scatter3d", mode: "lines+text", x: [from[0], to[0]], y: [from[1], to[1]],
        z: [from[2], to[2]], text: ["", `${"xyz"[n]} ${frame.name}`], hoverinfo: "skip",
        line: {width: 4, color: ["#d55e00", "#009e73", "#0072b2"][n]}, textfont: {size: 11}});
    });
  }
  const columns = ["x_m", "y_m", "z_m"].map(name => view.columns[name]);
  if (columns.every(Boolean)) {
    const [x, y, z] = columns.map(mm);
    data.push({type: "scatter3d", mode: "markers", x, y, z, customdata: view.row,
      marker: {size: view.row.map(row => marked.has(row) ? 7 : 3.5),
        color: values ?? mark, colorscale: "Cividis", showscale: Boolean(values),
        colorbar: {title: {text: title, side: "right"}, thickness: 12},
        line: {width: view.row.map(row => marked.has(row) ? 2 : 0), color: second}},
      hovertemplate: "row %{customdata}<br>%{x:.2f}, %{y:.2f}, %{z:.2f} mm<extra></extra>"});
  }
  const side = name => axis(`${name} [mm]`, {backgroundcolor: "rgba(0,0,0,0)"});
  return [data, {margin: {l: 0, r: 0, t: 0, b: 0}, uirevision: "scene",
    scene: {aspectmode: "data", xaxis: side("x"), yaxis: side("y"), zaxis: side("z"),
      camera: {up: {x: 1, y: 0, z: 0}, eye: {x: 0.5, y: 1.6, z: 0.7}}}}];
}
