/** The tf tree as a list: who hangs on whom, how old, how often. */

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { t } from "../../i18n/text";
import { frameName, shortType } from "../../robot/names";
import type { Message } from "../../robot/subscriptions";
import { componentPanel, now, useMessages } from "../component";
import type { PanelContext, PanelKind } from "../registry";

interface Frame {
  parent: string;
  at: number;
  rate: number;
  isStatic: boolean;
}

/** Milliseconds between two drawings, and seconds after which a moving frame is old. */
const REDRAW = 500;
const OLD = 2;
const MOST = 2000;
const MOST_DEPTH = 64;

export const frames: PanelKind = {
  name: "frames",
  title: "frames.title",
  supportedTypes: ["tf2_msgs/TFMessage", "tf/tfMessage"],
  opens: (session) => shortType(session.graph.value.topics.get("/tf") ?? "").endsWith("TFMessage"),
  place: "below",
  init: componentPanel(FramesPanel),
};

interface Transform {
  header: { frame_id: string };
  child_frame_id: string;
}

function FramesPanel({ context }: { context: PanelContext }) {
  const { session, visible } = context;
  const tree = useRef(new Map<string, Frame>());
  const drawn = useSignal(0);
  const isVisible = visible.value;
  const take = ({ transforms }: Message, topic: string) => {
    const at = Date.now();
    for (const { header, child_frame_id } of (transforms as Transform[] | undefined) ?? []) {
      const child = frameName(child_frame_id);
      const known = tree.current.get(child);
      if (!known && tree.current.size >= MOST) continue;
      const since = known ? (at - known.at) / 1000 : 0;
      const rate = known && since > 0 ? known.rate * 0.9 + 0.1 / since : (known?.rate ?? 0);
      tree.current.set(child, {
        parent: frameName(header?.frame_id),
        at,
        rate,
        isStatic: topic === "/tf_static",
      });
    }
  };
  useMessages(session, ["/tf", "/tf_static"], take, { isOn: isVisible });
  useEffect(() => {
    if (!isVisible) return undefined;
    const timer = setInterval(() => drawn.value++, REDRAW);
    return () => clearInterval(timer);
  }, [isVisible, drawn]);
  drawn.value;
  const children = new Map<string, string[]>();
  for (const [child, { parent }] of tree.current)
    children.set(parent, [...(children.get(parent) ?? []), child]);
  const roots = [...children.keys()].filter((name) => !tree.current.has(name)).sort();
  if (!roots.length) return <p class="faint">{t("panel.waiting", { name: "/tf" })}</p>;
  return (
    <ul class="tree frames">
      {roots.map((root) => (
        <Branch key={root} name={root} tree={tree.current} of={children} depth={0} />
      ))}
    </ul>
  );
}

function Branch(props: { name: string; tree: Map<string, Frame>; of: Map<string, string[]>; depth: number }) {
  const { name, tree, of, depth } = props;
  const frame = tree.get(name);
  const age = frame ? Math.max(0, (now.value - frame.at) / 1000) : 0;
  const below = depth < MOST_DEPTH ? (of.get(name) ?? []).sort() : [];
  return (
    <li>
      {name}{" "}
      {frame && (
        <span class={!frame.isStatic && age > OLD ? "problem" : "faint"}>
          {frame.isStatic
            ? t("frames.static")
            : `${frame.rate.toFixed(1)} Hz · ${t("topics.age")} ${age.toFixed(0)} s`}
        </span>
      )}
      {below.length > 0 && (
        <ul>
          {below.map((each) => (
            <Branch key={each} {...props} name={each} depth={depth + 1} />
          ))}
        </ul>
      )}
    </li>
  );
}
