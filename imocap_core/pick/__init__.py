"""The page in the browser on which an action.yaml is edited."""
