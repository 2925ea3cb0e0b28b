/** Error text beside its cause. */

import { Component, type ComponentChildren } from "preact";
import { Language } from "../i18n/context";

/** Something that is wrong. */
export function Problem({ text }: { text: string }) {
  return (
    <p part="problem" class="problem" role="alert">
      {text}
    </p>
  );
}

/** A fault of what is in it is said in its place. */
export class Guard extends Component<{ children: ComponentChildren }, { error: Error | null }> {
  override state = { error: null as Error | null };

  override componentDidCatch(error: Error): void {
    this.setState({ error });
  }

  static override contextType = Language;

  render() {
    if (!this.state.error) return this.props.children;
    return <Problem text={this.context("panel.failed", { reason: this.state.error.message })} />;
  }
}
