// @vitest-environment happy-dom

import { signal } from "@preact/signals";
import { afterEach, beforeEach, describe, expect, test, vi } from "vitest";
import { number, text } from "../../src/elements/base/attributes";
import type { Robot } from "../../src/elements/base/connections";
import { COMMON, defineElement, RobotElement, type ViewProps } from "../../src/elements/base/element";

class SpeedElement extends RobotElement {
  static override attributes = { ...COMMON, topLimit: number(2, 0, 10), unit: text("m/s") };
  declare robot: string;
  declare topLimit: number;
  declare unit: string;
  protected override readonly view = SpeedView;
}

function SpeedView({ element }: ViewProps<SpeedElement>) {
  return (
    <p part="value">
      {element.topLimit} {element.unit}
    </p>
  );
}
defineElement("rwt-test-speed", SpeedElement);

class BrokenElement extends RobotElement {
  static override attributes = COMMON;
  protected override readonly view = () => {
    throw new Error("a fault");
  };
}
defineElement("rwt-test-broken", BrokenElement);

/** A robot whose connection is as it is told. */
function robotThat(state: string): Robot {
  const session = {
    url: "ws://robot:9090",
    state: signal(state),
    reason: signal("no token"),
    connections: signal(state === "open" ? 1 : 0),
    authenticate: vi.fn(),
  };
  return { session, stop: {} } as unknown as Robot;
}

function make(robot: Robot, name = "rwt-test-speed"): RobotElement {
  const element = document.createElement(name) as RobotElement;
  element.robotShown = robot;
  document.body.append(element);
  return element;
}

const settled = () => new Promise((resolve) => setTimeout(resolve));
const said = (element: RobotElement) => element.shadowRoot?.textContent ?? "";

beforeEach(() => {
  document.body.innerHTML = "";
});
afterEach(() => {
  document.body.innerHTML = "";
});

describe("attributes and properties", () => {
  test("are one thing", async () => {
    const element = make(robotThat("open")) as SpeedElement;
    expect(said(element)).toBe("2 m/s");
    element.setAttribute("top-limit", "3");
    expect(element.topLimit).toBe(3);
    element.topLimit = 50;
    expect(element.getAttribute("top-limit")).toBe("10");
    element.unit = "km/h";
    await settled();
    expect(said(element)).toBe("10 km/h");
    element.topLimit = 2;
    expect(element.hasAttribute("top-limit")).toBe(false);
    element.setAttribute("top-limit", "nonsense");
    expect(element.topLimit).toBe(2);
  });

  test("that were set before the script was there count", () => {
    const late = document.createElement("rwt-test-speed") as SpeedElement;
    for (const [name, value] of Object.entries({ topLimit: 7, robotShown: robotThat("open") })) {
      Object.defineProperty(late, name, { value, configurable: true, writable: true });
    }
    document.body.append(late);
    expect(said(late)).toBe("7 m/s");
    expect(late.getAttribute("top-limit")).toBe("7");
  });
});

describe("what is wrong is said", () => {
  test("an address that is none", () => {
    const element = document.createElement("rwt-test-speed") as SpeedElement;
    element.setAttribute("robot", "<img onerror=x>");
    document.body.append(element);
    expect(said(element)).toBe(
      "The attribute robot must be a URL such as ws://robot:9090, not <img onerror=x>.",
    );
    expect(element.shadowRoot?.querySelector("img")).toBeNull();
  });

  test("a robot that was never reached, and one that was lost", async () => {
    const robot = robotThat("lost");
    const element = make(robot);
    expect(said(element)).toContain("The robot at ws://robot:9090 cannot be reached");
    robot.session.connections.value = 1;
    await settled();
    expect(said(element)).toContain("Connection lost, retrying");
    robot.session.state.value = "open";
    await settled();
    expect(said(element)).toBe("2 m/s");
  });

  test("a fault of a view", async () => {
    const element = make(robotThat("open"), "rwt-test-broken");
    await settled();
    expect(said(element)).toBe("This panel failed: a fault");
  });
});

test("a token is asked for, kept for the tab, and shown", () => {
  const robot = robotThat("refused");
  const element = make(robot);
  const field = element.shadowRoot?.querySelector("input") as HTMLInputElement;
  expect(field.type).toBe("password");
  field.value = " secret ";
  element.shadowRoot?.querySelector("form")?.dispatchEvent(new Event("submit", { cancelable: true }));
  expect(robot.session.authenticate).toHaveBeenCalledWith("secret");
  expect(sessionStorage.getItem("rwt-token ws://robot:9090")).toBe("secret");
});

test("an element that leaves the page is empty, and full again when it comes back", () => {
  const element = make(robotThat("open"));
  element.remove();
  expect(said(element)).toBe("");
  document.body.append(element);
  expect(said(element)).toBe("2 m/s");
});

describe("an element speaks the language of where it is", () => {
  const lost = () => make(robotThat("lost"));
  afterEach(() => {
    document.documentElement.lang = "en";
  });

  test("of its own attribute before the document's, and changes with it", async () => {
    document.documentElement.lang = "en";
    const [english, german] = [lost(), lost()];
    german.lang = "de-CH";
    await vi.waitFor(() => expect(said(german)).toContain("ist nicht zu erreichen"));
    expect(said(english)).toContain("cannot be reached");
    expect(german.shadowRoot?.querySelector(".frame")?.getAttribute("lang")).toBe("de");
    german.removeAttribute("lang");
    await vi.waitFor(() => expect(said(german)).toContain("cannot be reached"));
  });

  test("of the document, and of what is between", async () => {
    document.documentElement.lang = "de";
    const element = lost();
    await vi.waitFor(() => expect(said(element)).toContain("ist nicht zu erreichen"));
    const section = document.createElement("section");
    section.lang = "en";
    document.body.append(section);
    section.append(element);
    await vi.waitFor(() => expect(said(element)).toContain("cannot be reached"));
  });

  test("English, and says so, where there is no table", async () => {
    document.documentElement.lang = "fr";
    const element = lost();
    await vi.waitFor(() => expect(said(element)).toContain("cannot be reached"));
    expect(element.shadowRoot?.querySelector(".frame")?.getAttribute("lang")).toBe("en");
  });
});
