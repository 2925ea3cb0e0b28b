/** Every kind of panel, in the order in which they open. */

import { device } from "./drive/device";
import { goal } from "./drive/goal";
import { joints } from "./drive/joints";
import { teleop } from "./drive/teleop";
import { actions, services } from "./graph/calls";
import { frames } from "./graph/frames";
import { nodes } from "./graph/nodes";
import { parameters } from "./graph/parameters";
import { topics } from "./graph/topics";
import { approvals } from "./health/approvals";
import { battery, diagnostics } from "./health/diagnostics";
import { log } from "./health/log";
import { player } from "./health/player";
import { server } from "./health/server";
import { register } from "./registry";
import { camera } from "./view/camera";
import { plot } from "./view/plot";
import { position } from "./view/position";
import { scene } from "./view/scene";
import { values } from "./view/values";
import { wall } from "./view/wall";

const inOrder = [
  scene,
  camera,
  wall,
  teleop,
  joints,
  goal,
  approvals,
  device,
  topics,
  plot,
  values,
  position,
  services,
  actions,
  parameters,
  log,
  diagnostics,
  battery,
  frames,
  nodes,
  player,
  server,
];
for (const kind of inOrder) register(kind);
