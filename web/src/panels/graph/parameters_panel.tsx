/** Parameters of the robot's nodes: typed, with the ranges that they declare. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Commanding } from "../../forms/commanding";
import { Choice } from "../../forms/inputs";
import { Problem } from "../../forms/problem";
import { t } from "../../i18n/text";
import { keepAsking } from "../../robot/asking";
import type { RobotSession } from "../../robot/session";
import type { PanelContext } from "../registry";

/** Descriptor of a parameter. */
interface Descriptor {
  name: string;
  description: string;
  read_only: boolean;
  integer_range: { from_value: number; to_value: number; step: number }[];
  floating_point_range: { from_value: number; to_value: number; step: number }[];
}

interface Parameter {
  /** `/node:name` on ROS 2, `/name` on ROS 1. */
  name: string;
  value: unknown;
  problem: string;
}

const MOST = 300;

/** The node that a parameter is of; on ROS 1 the way to it. */
export function nodeOf(name: string): string {
  const colon = name.indexOf(":");
  return colon >= 0 ? name.slice(0, colon) : name.slice(0, Math.max(1, name.lastIndexOf("/")));
}

async function read(session: RobotSession, name: string): Promise<Parameter> {
  try {
    const answer = await session.call<{ value: string; successful?: boolean; reason?: string }>(
      "/rosapi/get_param",
      {
        name,
      },
    );
    if (answer.successful === false) return { name, value: null, problem: answer.reason ?? "" };
    return { name, value: JSON.parse(answer.value || "null"), problem: "" };
  } catch (error) {
    return { name, value: null, problem: (error as Error).message };
  }
}

async function describe(session: RobotSession, service: string, names: string[]): Promise<Descriptor[]> {
  try {
    const { descriptors } = await session.call<{ descriptors: Descriptor[] }>(service, { names });
    return descriptors;
  } catch {
    return []; // The ranges are a help; without them the robot still refuses what does not fit.
  }
}

export function Panel({ context }: { context: PanelContext }) {
  const { session, config } = context;
  const names = useSignal<string[]>([]);
  const problem = useSignal("");
  const again = useSignal(0);
  const connected = session.connections.value;
  const reload = again.value;
  // Asked again after each connection and on request.
  useEffect(
    () =>
      keepAsking(
        session,
        () => session.call<{ names: string[] }>("/rosapi/get_param_names", {}),
        (answer) => {
          names.value = answer.names.sort();
        },
        (reason) => {
          problem.value = reason;
        },
      ),
    [session, reload],
  );
  const nodes = [...new Set(names.value.map(nodeOf))];
  const chosen = String(config.value.node ?? nodes[0] ?? "");
  return (
    <div class="parameters">
      <div class="plot-bar">
        <Choice
          label={t("parameters.node")}
          chosen={chosen}
          options={nodes}
          onChoose={(node) => {
            config.value = { ...config.value, node };
          }}
        />
        <button
          type="button"
          onClick={() => {
            again.value++;
          }}
        >
          {t("parameters.reload")}
        </button>
      </div>
      {problem.value && <Problem text={problem.value} />}
      {names.value.length === 0 && !problem.value && <p class="faint">{t("parameters.none")}</p>}
      <NodeParameters
        key={`${chosen} ${reload} ${connected}`}
        context={context}
        node={chosen}
        names={names.value.filter((name) => nodeOf(name) === chosen).slice(0, MOST)}
      />
    </div>
  );
}

function NodeParameters(props: { context: PanelContext; node: string; names: string[] }) {
  const { context, node, names } = props;
  const { session } = context;
  const values = useSignal<Parameter[]>([]);
  const descriptors = useSignal(new Map<string, Descriptor>());
  const key = names.join(" ");
  const service = `${node}/describe_parameters`;
  // What services there are may be known later than the names.
  const isDescribed = session.graph.value.services.includes(service) && session.may("call", service);
  // The names are what counts.
  useEffect(() => {
    void Promise.all(names.map((name) => read(session, name))).then((all) => {
      values.value = all;
    });
  }, [session, key]);
  useEffect(() => {
    if (!isDescribed || !names.length) return;
    void describe(
      session,
      service,
      names.map((name) => name.slice(node.length + 1)),
    ).then((all) => {
      descriptors.value = new Map(all.map((each) => [each.name, each]));
    });
  }, [session, key, isDescribed]);
  return (
    <Commanding session={session}>
      <table>
        <tbody>
          {values.value.map((parameter) => (
            <Row
              key={parameter.name}
              context={context}
              parameter={parameter}
              descriptor={descriptors.value.get(parameter.name.slice(node.length + 1))}
            />
          ))}
        </tbody>
      </table>
    </Commanding>
  );
}

function Row(props: { context: PanelContext; parameter: Parameter; descriptor: Descriptor | undefined }) {
  const { context, parameter, descriptor } = props;
  const { session } = context;
  const { name } = parameter;
  const value = useSignal(parameter.value);
  const problem = useSignal(parameter.problem);
  const fixed = descriptor?.read_only || !session.may("set_param", name);
  const id = `parameter ${name}`;
  const set = async (next: unknown) => {
    problem.value = "";
    try {
      const request = { name, value: JSON.stringify(next) };
      const answer = await session.commands.call<{ successful?: boolean; reason?: string }>(
        "/rosapi/set_param",
        request,
      );
      if (answer.successful === false) throw new Error(answer.reason);
      value.value = next;
    } catch (error) {
      problem.value = (error as Error).message;
      value.value = (await read(session, name)).value;
    }
  };
  const setText = (text: string) => {
    if (typeof value.peek() === "string") return void set(text);
    try {
      const next: unknown = JSON.parse(text);
      if (typeof next !== typeof value.peek())
        throw new Error(t("parameters.kind", { kind: typeof value.peek() }));
      void set(next);
    } catch (error) {
      problem.value = (error as Error).message;
    }
  };
  const current = value.value;
  const range = descriptor?.floating_point_range[0] ?? descriptor?.integer_range[0];
  return (
    <tr>
      <th scope="row">
        <label for={id}>{name.includes(":") ? name.slice(name.indexOf(":") + 1) : name}</label>
      </th>
      <td>
        {typeof current === "boolean" ? (
          <input
            id={id}
            type="checkbox"
            checked={current}
            disabled={fixed}
            onChange={(event) => set(event.currentTarget.checked)}
          />
        ) : (
          <input
            id={id}
            type="text"
            value={typeof current === "string" ? current : JSON.stringify(current)}
            disabled={fixed}
            onChange={(event) => setText(event.currentTarget.value)}
          />
        )}
        {range && typeof current === "number" && (
          <input
            type="range"
            aria-label={name}
            min={range.from_value}
            max={range.to_value}
            step={range.step || "any"}
            value={current}
            disabled={fixed}
            onChange={(event) => set(Number(event.currentTarget.value))}
          />
        )}
        {problem.value && <Problem text={problem.value} />}
      </td>
      <td class="faint">
        {descriptor?.description}
        {fixed && ` (${t("parameters.fixed")})`}
        {range && ` ${range.from_value} … ${range.to_value}`}
      </td>
    </tr>
  );
}
