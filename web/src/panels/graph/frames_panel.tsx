/** The tf tree as a list: parents and children, rates and ages, and above it what is wrong with the tree. */

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { fixed } from "../../i18n/formats";
import { t } from "../../i18n/text";
import { type Transform, TransformTree, type TreeFault } from "../../robot/transforms";
import { Needs, now, useMessages } from "../component";
import type { PanelContext } from "../registry";
import { frames } from "./frames";

/** Milliseconds between two drawings, and seconds after which a moving frame is old. */
const REDRAW = 500;
const OLD = 2;
const MOST_DEPTH = 64;
/** Faults that are shown, and frames that are named in one of them. */
const MOST_FAULTS = 30;
const MOST_NAMES = 12;

export function Panel({ context }: { context: PanelContext }) {
  const { session, visible } = context;
  const tree = useRef(new TransformTree()).current;
  const drawn = useSignal(0);
  const isVisible = visible.value;
  const robotTime = useRef(0);
  const isThere = useMessages(
    session,
    ["/tf", "/tf_static"],
    ({ transforms, $time }, topic) => {
      // A recording says when its messages were received.
      robotTime.current = Number($time ?? session.robotTime / 1000);
      if (Array.isArray(transforms)) {
        tree.take(transforms as Transform[], topic === "/tf_static", robotTime.current);
      }
    },
    { isOn: isVisible },
  );
  useEffect(() => {
    if (!isVisible) return undefined;
    const timer = setInterval(() => drawn.value++, REDRAW);
    return () => clearInterval(timer);
  }, [isVisible, drawn]);
  drawn.value;
  if (!tree.frames.size && !isThere) return <Needs kind={frames} />;
  if (!tree.frames.size) return <p class="faint">{t("panel.waiting", { name: "/tf" })}</p>;
  const { children, faults, loops, roots } = tree;
  const time = session.isRecording ? robotTime.current : session.robotTime / 1000;
  now.value; // The ages go on where nothing comes any more.
  return (
    <>
      <Faults context={context} faults={faults} />
      <ul class="tree frames">
        {[...roots, ...loops.map(([first]) => first as string)].map((root) => (
          <Branch key={root} name={root} above={[]} {...{ tree, children, time }} />
        ))}
      </ul>
    </>
  );
}

function Faults({ context, faults }: { context: PanelContext; faults: readonly TreeFault[] }) {
  const { session } = context;
  const publishers = useSignal<readonly string[]>([]);
  const conflicts = faults.filter(({ kind }) => kind === "parents").map(({ frames }) => frames[0]);
  useEffect(() => {
    if (!conflicts.length || session.isRecording) return;
    const ask = (topic: string) =>
      session.call<{ publishers: string[] }>("/rosapi/publishers", { topic }).then(
        (answer) => answer.publishers,
        () => [],
      );
    void Promise.all(["/tf", "/tf_static"].map(ask)).then((names) => {
      publishers.value = [...new Set(names.flat())].sort();
    });
  }, [conflicts.join("\n")]);
  if (!faults.length) return null;
  return (
    <ul class="frame-faults" aria-label={t("frames.faults")}>
      {faults.slice(0, MOST_FAULTS).map((fault) => (
        <li key={`${fault.kind} ${fault.frames.join()}`} class="problem">
          {faultText(fault, publishers.value)}
        </li>
      ))}
      {faults.length > MOST_FAULTS && <li>{t("frames.more", { count: faults.length - MOST_FAULTS })}</li>}
    </ul>
  );
}

function faultText(fault: TreeFault, publishers: readonly string[]): string {
  const names = (all: readonly string[], between: string) =>
    all.slice(0, MOST_NAMES).join(between) + (all.length > MOST_NAMES ? `${between}…` : "");
  const [name = ""] = fault.frames;
  switch (fault.kind) {
    case "loop":
      return t("frames.loop", { names: names([...fault.frames, name], " → ") });
    case "parents":
      return [
        t("frames.parents", { name, names: names(fault.parents, ", ") }),
        publishers.length ? t("frames.publishers", { names: names(publishers, ", ") }) : "",
      ].join(" ");
    case "islands":
      return t("frames.islands", { count: fault.frames.length, names: names(fault.frames, ", ") });
    case "old":
    case "future":
      return t(`frames.${fault.kind}`, { name, seconds: fixed(fault.number, 1) });
    default:
      return t(`frames.${fault.kind}`, { name, count: fault.number });
  }
}

interface BranchProps {
  name: string;
  /** The frames above, so that a loop has an end. */
  above: readonly string[];
  tree: TransformTree;
  children: Map<string, string[]>;
  /** Seconds by the robot's clock. */
  time: number;
}

function Branch(props: BranchProps) {
  const { name, above, tree, time } = props;
  const frame = tree.frames.get(name);
  const age = frame ? Math.max(0, time - frame.at) : 0;
  const isAgain = above.includes(name);
  const below = isAgain ? [] : (props.children.get(name) ?? []);
  const isDeep = above.length >= MOST_DEPTH;
  return (
    <li>
      {name}{" "}
      {frame && !isAgain && (
        <span class={!frame.isStatic && age > OLD ? "problem" : "faint"}>
          {frame.isStatic
            ? t("frames.static")
            : `${fixed(frame.rate.hz, 1)} Hz · ${t("topics.age")} ${fixed(age, 0)} s`}
        </span>
      )}
      {isAgain && <span class="problem">{t("frames.again")}</span>}
      {below.length > 0 && isDeep && <span class="problem"> …</span>}
      {below.length > 0 && !isDeep && (
        <ul>
          {below.map((each) => (
            <Branch key={each} {...props} name={each} above={[...above, name]} />
          ))}
        </ul>
      )}
    </li>
  );
}
