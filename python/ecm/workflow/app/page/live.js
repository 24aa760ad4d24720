// The simulated rig at work: planned poses are faint, each reading is a point as soon as it is there.

import {get} from "./api.js";
import {axesOf, bent, profileOf} from "./bend.js";
import {colours, faded, rgb, scaleOf} from "./colours.js";
import {el, number} from "./dom.js";
import {term} from "./help.js";
import {mm, POSE} from "./scene.js";
import {bodyColour, space} from "./space.js";

const EVERY_MS = 150;
const PLANNED = 0.7;  // of the grey of a planned pose: three times as light or dark as the ground

export const measures = state => state.running !== null
  && (state.steps.find(step => step.number === state.running.step)?.command ?? "").startsWith("ecm campaign ");

export function live() {
  const count = el("p", {class: "hint", id: "live"}, "The forces at the planned poses are computed first.");
  const drawn = space("Planned poses, and the readings of the simulated rig as they come");
  const node = el("section", {"aria-label": "Readings as they come"},
    el("h3", {}, "The simulated rig measures, ", term("readings", "reading by reading")), count, drawn.node);
  let known = null;
  const look = async () => {
    if (known && !node.isConnected) return;
    const found = await get(`/api/live?after=${known ? known.row.length : 0}`).catch(() => ({step: null}));
    if (found.step !== null && (found.plan || found.step !== known.step)) known = found.plan ? found : null;
    else if (found.step !== null) join(known, found);
    if (found.step !== null && known && (found.plan || found.row.length)) {
      drawn.set(sceneOf(known));
      const seen = known.row.length;
      if (seen) count.textContent = `${seen} ${seen === 1 ? "reading" : "readings"} so far; the last force is `
        + `${number(known.force_N.at(-1))} N. Faint points are planned.`;
    }
    setTimeout(look, EVERY_MS);
  };
  look();
  return node;
}

// The server sends what is new.
function join(known, found) {
  known.row.push(...found.row);
  known.force_N.push(...found.force_N);
  for (const name of POSE) known.columns[name].push(...found.columns[name]);
}

function sceneOf({plan, row, columns, force_N: force}) {
  const profile = profileOf(plan), n = row.length, of = (source, k) => mm(source.columns[POSE[k]]);
  const scale = scaleOf(Math.max(1e-9, ...force)), {soft, wash} = colours();
  const planned = faded(rgb(soft), rgb(wash), PLANNED);
  const [x, y, z] = [0, 1, 2].map(k => [...of(plan, k), ...of({columns}, k)]);
  const body = (pose, colour, alpha) => {
    const {points, triangles} = bent(profile, pose);
    return {points: points.map(mm), triangles, colour, alpha};
  };
  const bodies = [body([profile.length, 0, 0, 0, 0, 0], bodyColour(), n ? 0.25 : 0.4)];
  const frames = plan.frames.map(frame => ({name: frame.name, origin: mm(frame.origin_m), axes: frame.axes, size: 300 * profile.length}));
  if (n) {
    const now = POSE.map(name => columns[name][n - 1]);
    bodies.push(body(now, scale(force[n - 1]), 1));
    frames.push({name: "", origin: mm(now.slice(0, 3)), axes: axesOf(now.slice(3)), size: 180 * profile.length});
  }
  const before = x.length - n;
  return {bodies, frames, points: {x, y, z, row: x.map((_, i) => i < before ? -1 - i : row[i - before]),
    colour: x.map((_, i) => i < before ? planned : scale(force[i - before])),
    text: i => i < before ? `planned: ${number(x[i])}, ${number(y[i])}, ${number(z[i])} mm`
      : `reading ${row[i - before]}: force ${number(force[i - before])} N`}};
}
