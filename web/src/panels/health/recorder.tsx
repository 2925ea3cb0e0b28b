/** The robot's own recorder: begin, end, and how far it is. */

import { useSignal } from "@preact/signals";
import { Download, Play } from "lucide";
import { useEffect } from "preact/hooks";
import { Commanding } from "../../forms/commanding";
import { Icon } from "../../forms/icon";
import { TextField } from "../../forms/inputs";
import { Problem } from "../../forms/problem";
import { fixed } from "../../i18n/formats";
import { t } from "../../i18n/text";
import { seconds } from "../../robot/names";
import type { Message } from "../../robot/subscriptions";
import { now, Refusal, saveAs, useMessages } from "../component";
import type { PanelContext } from "../registry";

const START = "/recorder/start";
const STOP = "/recorder/stop";
const STATE = "/recorder/state";

interface RecorderState {
  recording: boolean;
  file: string;
  since: unknown;
  messages: number;
  bytes: number;
  largest_bytes: number;
  dropped: number;
  problem: string;
}

/** Return true if a robot with these services records by them. */
export function hasRecorder(services: readonly string[]): boolean {
  return services.includes(START) && services.includes(STOP);
}

/** A number of octets for people. */
export function sizeText(octets: number): string {
  if (octets < 1e3) return `${octets} B`;
  const units = ["kB", "MB", "GB", "TB"];
  let value = octets;
  let unit = -1;
  while (value >= 999.95 && unit < units.length - 1) {
    value /= 1e3;
    unit++;
  }
  return `${fixed(value, 1)} ${units[unit]}`;
}

export function Recorder({ context }: { context: PanelContext }) {
  const { session, visible } = context;
  const state = useSignal<RecorderState | null>(null);
  const name = useSignal("");
  const problem = useSignal("");
  const take = (message: Message) => {
    state.value = message as unknown as RecorderState;
  };
  useMessages(session, STATE, take, { isOn: visible.value });
  if (!session.may("call", START)) return <Refusal context={context} act="call" name={START} />;
  const ask = async (service: string, request: Record<string, unknown>) => {
    try {
      const { commands } = session;
      const answer = await (service === STOP
        ? commands.callSafe<{ success: boolean; message: string }>(service, request)
        : commands.call<{ success: boolean; message: string }>(service, request));
      problem.value = answer.success ? "" : answer.message;
    } catch (error) {
      problem.value = (error as Error).message;
    }
  };
  const recorded = state.value;
  return (
    <section class="player recorder">
      <h2>{t("recorder.title")}</h2>
      <form
        class="plot-bar"
        onSubmit={(event) => {
          event.preventDefault();
          if (recorded?.recording) void ask(STOP, {});
          else void ask(START, { name: name.value.trim(), topics: [] });
        }}
      >
        {!recorded?.recording && <TextField label={t("recorder.name")} text={name} inline maxLength={64} />}
        {recorded?.recording ? (
          <button type="submit">{t("recorder.stop")}</button>
        ) : (
          <Commanding session={session} quiet>
            <button type="submit">{t("recorder.start")}</button>
          </Commanding>
        )}
      </form>
      {recorded?.file && <p role="status">{stateText(recorded)}</p>}
      {recorded?.problem && <Problem text={recorded.problem} />}
      {recorded && recorded.dropped > 0 && (
        <Problem text={t("recorder.dropped", { count: recorded.dropped })} />
      )}
      {problem.value && <Problem text={problem.value} />}
      {session.permissions.value.has("recordings") && session.may("subscribe", ANY_TOPIC) && (
        <Recordings key={`${recorded?.recording} ${recorded?.file}`} context={context} />
      )}
    </section>
  );
}

interface Recording {
  name: string;
  bytes: number;
  /** Seconds since 1970. */
  modified: number;
}

/** A name that only roles with every topic may subscribe to: these may read recordings. */
const ANY_TOPIC = "/*";
/** Milliseconds for the list to come. */
const PATIENCE = 10_000;

/** The files that the robot has recorded, to play and to download. */
function Recordings({ context }: { context: PanelContext }) {
  const { session } = context;
  const files = useSignal<Recording[]>([]);
  const busy = useSignal("");
  const problem = useSignal("");
  const get = async (path: string, signal: AbortSignal | null) => {
    const response = await fetch(new URL(path, session.httpBase), { headers: session.httpHeaders, signal });
    if (!response.ok) throw new Error((await response.text()).trim());
    return response;
  };
  const attempt = async (act: () => Promise<void>) => {
    try {
      await act();
      problem.value = "";
    } catch (error) {
      problem.value = (error as Error).message;
    }
  };
  useEffect(() => {
    void attempt(async () => {
      files.value = await (await get("recordings", AbortSignal.timeout(PATIENCE))).json();
    });
  }, []);
  // By a request with the token, which a link has not.
  const load = (name: string, use: (content: Blob) => void) =>
    attempt(async () => {
      busy.value = name;
      try {
        use(await (await get(`recordings/${encodeURIComponent(name)}`, null)).blob());
      } finally {
        busy.value = "";
      }
    });
  const act = (icon: typeof Play, title: string, name: string, use: (content: Blob) => void) => (
    <button
      type="button"
      disabled={busy.value !== ""}
      aria-label={title}
      title={title}
      onClick={() => load(name, use)}
    >
      <Icon of={icon} />
    </button>
  );
  return (
    <>
      {problem.value && <Problem text={problem.value} />}
      {files.value.length > 0 && (
        <table class="recordings">
          <caption class="hidden">{t("recorder.files")}</caption>
          <tbody>
            {files.value.map(({ name, bytes, modified }) => (
              <tr key={name}>
                <th scope="row">{name}</th>
                <td class="faint">{new Date(modified * 1000).toLocaleString()}</td>
                <td class="number">{sizeText(bytes)}</td>
                <td>
                  {act(Play, t("recorder.play", { name }), name, (content) =>
                    context.openRecording(new File([content], name)),
                  )}
                  {act(Download, t("recorder.download", { name }), name, (content) => saveAs(content, name))}
                </td>
              </tr>
            ))}
          </tbody>
        </table>
      )}
    </>
  );
}

function stateText({ recording, file, since, messages, bytes, largest_bytes }: RecorderState): string {
  const size = sizeText(bytes);
  if (!recording) return t("recorder.last", { file, messages, size });
  const span = Math.max(0, Math.round(now.value / 1000 - seconds(since)));
  return t("recorder.state", { file, seconds: span, messages, size, most: sizeText(largest_bytes) });
}
