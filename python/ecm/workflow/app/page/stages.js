// The seven stages in their order; each needs the one before.

import * as add from "./add.js";
import {effectName, measured} from "./columns.js";
import * as data from "./data.js";
import * as fails from "./fails.js";
import * as missing from "./missing.js";
import * as model from "./model.js";
import * as next from "./next.js";
import {errorWords} from "./noise.js";
import * as out from "./out.js";

const checked = state => Boolean(state.check) && measured(state.check) && state.pending.length === 0;
const fitted = state => Boolean(state.model);
const verdict = state => !state.diagnosis ? "not asked yet"
  : state.diagnosis.verdict === "named" ? state.diagnosis.answer.map(set => set.map(effectName).join(" + ")).join(" or ")
    : {none: "nothing", unknown: "an unknown cause", family: "a known driver", ambiguous: "several look alike"}[state.diagnosis.verdict];

export const stages = [
  {id: "data", title: "Data", draw: data.draw, open: () => true, needs: "",
    purpose: "Bring in a table of measured poses and wrenches, and see that it is right.",
    brief: state => !state.data.length ? "nothing yet" : state.check ? `${state.check.rows} rows` : "not checked yet"},
  {id: "model", title: "Model", draw: model.draw, open: checked, needs: "needs checked data",
    purpose: "Choose what predicts the wrench at a pose, and fit it.",
    brief: state => effectName(state.rungs[0]?.name ?? "none yet")},
  {id: "fails", title: "Where it fails", draw: fails.draw, open: fitted, compares: true,
    needs: "needs a model",
    purpose: "See in which poses, and along which variable, the model and the measurement differ.",
    brief: state => state.compare ? errorWords(state) : "not computed yet"},
  {id: "missing", title: "What is missing", draw: missing.draw, open: fitted, compares: true,
    needs: "needs a model", late: true,
    purpose: "Which physical effect, or which error of the measurement, would explain the rest.",
    brief: verdict},
  {id: "add", title: "Add", draw: add.draw, open: fitted, needs: "needs a model", late: true,
    purpose: "Add an effect, fit again, and watch the error on poses that the fit never saw.",
    brief: state => state.rungs.length > 1 ? `${state.rungs.length - 1} added` : "the base only"},
  {id: "next", title: "Next experiment", draw: next.draw, open: state => Boolean(state.diagnosis),
    purpose: "What to measure so that the verdict becomes sure.",
    needs: "needs a verdict", late: true,
    brief: state => state.diagnosis.next_experiment.length ? `${state.diagnosis.next_experiment.length} proposed`
      : ["named", "none"].includes(state.diagnosis.verdict) ? "none needed" : "none known"},
  {id: "out", title: "Out", draw: out.draw, open: fitted,
    purpose: "Take the report, the model, the controller, and the commands that do all this again.",
    needs: "needs a model", late: true, brief: state => `${state.files.length} files`},
];
