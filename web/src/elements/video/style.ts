/** The style of `<rwt-video>`. */
export const style = `
:host {
  max-width: 640px;
}
canvas {
  display: block;
  width: 100%;
  max-height: 100%;
  object-fit: contain;
  background: #000000;
}
.waiting {
  visibility: hidden;
  height: 0;
}
`;
