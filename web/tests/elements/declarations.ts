/**
 * What the npm package declares is true of the elements, and leaves no element and no attribute of them out: then this file
 * compiles, for which `npm run types` is there. Nothing runs it.
 */

import type * as published from "../../package/widgets";
import type * as elements from "../../src/elements/widgets";

type Elements = typeof elements;
type Declared<Name extends keyof Elements> = InstanceType<(typeof published)[Name]>;

/** The attributes of an element that its declaration does not have. */
type LeftOut<Name extends keyof Elements> = Exclude<keyof Elements[Name]["attributes"], keyof Declared<Name>>;

/** True where an element has what is declared, of the same types, and no attribute besides. */
type IsDeclared<Name extends keyof Elements> =
  InstanceType<Elements[Name]> extends Declared<Name>
    ? [LeftOut<Name>] extends [never]
      ? true
      : false
    : false;

export const DECLARED: { [Name in keyof Elements]: IsDeclared<Name> } = {
  BatteryElement: true,
  MapElement: true,
  PlotElement: true,
  SceneElement: true,
  StopElement: true,
  TeleopElement: true,
  TopicElement: true,
  VideoElement: true,
};
