/** An icon for each kind of panel. */

import {
  Activity,
  Battery,
  Bolt,
  Camera,
  Box as Cube,
  Flag,
  Gauge,
  Grid2x2,
  type IconNode,
  List,
  ListChecks,
  MapPin,
  Move3d,
  Play,
  ScrollText,
  Server,
  ShieldCheck,
  SlidersHorizontal,
  SlidersVertical,
  Smartphone,
  ChartSpline as Spline,
  SquarePlay,
  LifeBuoy as Wheel,
  Workflow,
} from "lucide";

const ICONS: Record<string, IconNode> = {
  scene: Cube,
  camera: Camera,
  wall: Grid2x2,
  teleop: Wheel,
  joints: SlidersVertical,
  goal: Flag,
  approvals: ShieldCheck,
  device: Smartphone,
  topics: List,
  plot: Spline,
  values: Gauge,
  position: MapPin,
  services: Bolt,
  actions: Play,
  parameters: SlidersHorizontal,
  log: ScrollText,
  diagnostics: Activity,
  battery: Battery,
  frames: Move3d,
  nodes: Workflow,
  player: SquarePlay,
  server: Server,
};

/** The icon of a kind of panel. */
export function panelIcon(kind: string): IconNode {
  return ICONS[kind] ?? ListChecks;
}
