// The seven stages in their order; each needs the one before.

import * as add from "./add.js";
import * as data from "./data.js";
import * as fails from "./fails.js";
import * as missing from "./missing.js";
import * as model from "./model.js";
import * as next from "./next.js";
import * as out from "./out.js";

const checked = state => Boolean(state.check) && state.pending.length === 0;
const fitted = state => Boolean(state.model);

export const stages = [
  {id: "data", title: "Data", draw: data.draw, open: () => true, needs: "",
    brief: state => state.data.map(item => item.name).join(", ")},
  {id: "model", title: "Model", draw: model.draw, open: checked, needs: "needs checked data",
    brief: state => state.rungs[0]?.name ?? ""},
  {id: "fails", title: "Where it fails", draw: fails.draw, open: fitted, compares: true,
    needs: "needs a model",
    brief: state => state.compare ? `${state.compare.whitened_rms.toFixed(2)} times the noise` : ""},
  {id: "missing", title: "What is missing", draw: missing.draw, open: fitted, compares: true,
    needs: "needs a model", late: true,
    brief: state => state.diagnosis ? state.diagnosis.verdict : "not asked yet"},
  {id: "add", title: "Add", draw: add.draw, open: fitted, needs: "needs a model", late: true,
    brief: state => state.rungs.length > 1 ? `${state.rungs.length - 1} added` : ""},
  {id: "next", title: "Next experiment", draw: next.draw, open: state => Boolean(state.diagnosis),
    needs: "needs a verdict", late: true, brief: () => ""},
  {id: "out", title: "Out", draw: out.draw, open: fitted,
    needs: "needs a model", late: true, brief: () => ""},
];
