/** Recording and playing, through the services of the robot's recorder and those that rosbag2's nodes have. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Commanding } from "../../forms/commanding";
import { Choice, TextField } from "../../forms/inputs";
import { Problem } from "../../forms/problem";
import { t } from "../../i18n/text";
import type { Message } from "../../robot/subscriptions";
import { componentPanel, Refusal } from "../component";
import type { PanelContext, PanelKind } from "../registry";
import { hasRecorder, Recorder } from "./recorder";

/** Milliseconds between two looks. */
const PERIOD = 1000;
/** Services that change nothing. */
const QUESTIONS: ReadonlySet<string> = new Set(["is_paused", "get_rate"]);
const RATES = [0.1, 0.5, 1, 2, 5, 10];

/** Nodes with a service to toggle a pause: players and recorders. */
export function pausableNodes(services: readonly string[]): string[] {
  return services
    .filter((name) => name.endsWith("/toggle_paused") || name.endsWith("/is_paused"))
    .map((name) => name.slice(0, name.lastIndexOf("/")))
    .filter((name, at, all) => all.indexOf(name) === at)
    .sort();
}

export const player: PanelKind = {
  name: "player",
  title: "player.title",
  supportedTypes: ["rwt_recorder_msgs/RecorderState"],
  opens: ({ graph }) => hasRecorder(graph.value.services) || pausableNodes(graph.value.services).length > 0,
  place: "below",
  init: componentPanel(PlayerPanel),
};

function PlayerPanel({ context }: { context: PanelContext }) {
  const { services } = context.session.graph.value;
  const found = pausableNodes(services);
  const records = hasRecorder(services);
  return (
    <>
      {!found.length && !records && <p class="faint">{t("player.none")}</p>}
      {records && <Recorder context={context} />}
      {found.map((node) => (
        <Pausable key={node} context={context} node={node} />
      ))}
      <label class="file">
        {t("recording.open")}
        <input
          type="file"
          accept=".mcap"
          onChange={(event) => {
            const file = event.currentTarget.files?.[0];
            if (file) context.openRecording(file);
          }}
        />
      </label>
    </>
  );
}

function Pausable({ context, node }: { context: PanelContext; node: string }) {
  const { session, visible } = context;
  const has = (name: string) => session.graph.value.services.includes(`${node}/${name}`);
  const paused = useSignal<boolean | null>(null);
  const rate = useSignal(Number.NaN);
  const seek = useSignal("");
  const problem = useSignal("");
  const act = async (name: string, request: Message = {}) => {
    const service = `${node}/${name}`;
    try {
      const answer = await (QUESTIONS.has(name)
        ? session.call<{ success?: boolean }>(service, request)
        : name === "stop"
          ? session.commands.callSafe<{ success?: boolean }>(service, request)
          : session.commands.call<{ success?: boolean }>(service, request));
      problem.value = answer.success === false ? t("player.refused", { name }) : "";
      return answer as Message;
    } catch (error) {
      problem.value = (error as Error).message;
      return null;
    }
  };
  const askPaused = async () => {
    if (has("is_paused")) paused.value = ((await act("is_paused"))?.paused as boolean | undefined) ?? null;
  };
  const isVisible = visible.value;
  const may = session.may("call", `${node}/toggle_paused`);
  // What is asked does not change with what is drawn.
  useEffect(() => {
    if (!isVisible || !may) return undefined;
    const look = async () => {
      await askPaused();
      if (has("get_rate")) rate.value = Number((await act("get_rate"))?.rate);
    };
    void look();
    const timer = setInterval(look, PERIOD);
    return () => clearInterval(timer);
  }, [session, node, isVisible, may]);
  if (!may) return <Refusal context={context} act="call" name={`${node}/toggle_paused`} />;
  return (
    <section class="player">
      <h2>{node}</h2>
      <div class="plot-bar">
        <Commanding session={session} quiet>
          <button
            type="button"
            aria-pressed={paused.value === true}
            onClick={() => act("toggle_paused").then(askPaused)}
          >
            {paused.value ? t("player.resume") : t("plot.pause")}
          </button>
          {has("play_next") && (
            <button type="button" onClick={() => act("play_next")}>
              {t("player.next")}
            </button>
          )}
          {has("set_rate") && (
            <Choice
              label={t("player.rate")}
              chosen={String(rate.value)}
              options={[...new Set([rate.value, ...RATES])]
                .sort((a, b) => a - b)
                .map((it) => [String(it), `${it}×`])}
              onChoose={async (value) => {
                const wanted = Number(value);
                if (await act("set_rate", { rate: wanted })) rate.value = wanted;
              }}
            />
          )}
        </Commanding>
        {has("stop") && (
          <button type="button" onClick={() => act("stop")}>
            {t("player.stop")}
          </button>
        )}
      </div>
      {has("seek") && (
        <form
          class="plot-bar"
          onSubmit={(event) => {
            event.preventDefault();
            const to = Number(seek.value);
            if (!Number.isFinite(to) || seek.value.trim() === "") return;
            const whole = Math.floor(to);
            const rest = Math.round((to - whole) * 1e9);
            const two = session.version.peek() === 2;
            void act("seek", { time: two ? { sec: whole, nanosec: rest } : { secs: whole, nsecs: rest } });
          }}
        >
          <TextField label={t("player.seek")} text={seek} inline inputMode="decimal" />
          <Commanding session={session} quiet>
            <button type="submit">{t("player.go")}</button>
          </Commanding>
        </form>
      )}
      {problem.value && <Problem text={problem.value} />}
    </section>
  );
}
