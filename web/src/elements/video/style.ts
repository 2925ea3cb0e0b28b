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
.old {
  filter: grayscale(1) brightness(0.7);
}
.image-age {
  position: absolute;
  top: 0.4em;
  left: 0.4em;
}
.waiting {
  visibility: hidden;
  height: 0;
}
`;
