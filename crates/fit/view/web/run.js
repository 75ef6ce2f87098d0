// The page about a run without a scene.

import { Live } from "./live.js";

new Live(null);
