/** The style of `<rwt-scene>` and `<rwt-map>`. */
export const style = `
:host {
  height: 400px;
}
.scene {
  position: relative;
  display: flex;
  flex-direction: column;
  height: 100%;
}
.view {
  position: relative;
  flex: 1;
  min-height: 0;
  overflow: hidden;
}
.view canvas {
  display: block;
}
.goals {
  display: flex;
  flex-wrap: wrap;
  align-items: center;
  gap: 0.5em;
  padding: 4px 0;
}
[aria-pressed="true"] {
  background: var(--rwt-accent);
  color: #ffffff;
}
`;
