// What every part of the page draws with: Preact, its hooks, and `html` for templates.

import { h, render, Component, Fragment, createContext } from "../vendor/preact.js";
import htm from "../vendor/htm.js";

export { h, render, Component, Fragment, createContext };
export {
  useState, useEffect, useLayoutEffect, useMemo, useRef, useCallback, useContext, useId,
} from "../vendor/preact-hooks.js";

export const html = htm.bind(h);
