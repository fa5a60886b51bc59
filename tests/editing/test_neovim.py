"""Neovim as the editor, without a screen: its own client opens, edits, asks and renames."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.editing.project import Project

_PLUGIN = Path(__file__).parents[2] / "editors" / "neovim" / "colony.lua"

_SCRIPT = """
local function fail(what) print("FAILED " .. what); vim.cmd("cquit 1") end
vim.cmd("edit patrol.colony")
local id
local buffer = vim.api.nvim_get_current_buf()
local function wait(what, f) if not vim.wait(60000, f, 20) then fail(what) end end
local function ask(method, params)
  local found = vim.lsp.buf_request_sync(buffer, method, params, 60000)
  if found == nil or found[id] == nil or found[id].result == nil then fail(method) end
  return found[id].result
end
local function at(text)
  local line = vim.fn.search("\\\\V" .. text, "w") - 1
  local column = vim.fn.match(vim.fn.getline(line + 1), "\\\\V" .. text)
  local document = vim.lsp.util.make_text_document_params(buffer)
  return { textDocument = document, position = { line = line, character = column } }
end
wait("start", function() return next(vim.lsp.buf_get_clients(0)) ~= nil end)
id = next(vim.lsp.buf_get_clients(0))
local out = {}
out.hover = ask("textDocument/hover", at("ahead =")).contents.value
vim.fn.search("when close", "w")
vim.cmd("normal! wciwclsoe")
wait("findings", function() return #vim.diagnostic.get(buffer) > 0 end)
out.finding = vim.diagnostic.get(buffer)[1].message
local params = at("clsoe")
params.range = { start = params.position, ["end"] = params.position }
params.context = { diagnostics = {} }
local action = ask("textDocument/codeAction", params)[1]
out.fix = action.title
vim.lsp.util.apply_workspace_edit(action.edit, "utf-16")
wait("mended", function()
  for _, one in ipairs(vim.diagnostic.get(buffer)) do
    if one.message:find("clsoe") then return false end
  end
  return true
end)
local new = at("room =")
new.newName = "space"
vim.lsp.util.apply_workspace_edit(ask("textDocument/rename", new), "utf-16")
out.text = table.concat(vim.api.nvim_buf_get_lines(buffer, 0, -1, false), "\\n")
print(vim.fn.json_encode(out))
vim.lsp.stop_client(id)
vim.cmd("qall!")
"""


@pytest.mark.long
@pytest.mark.skipif(shutil.which("nvim") is None, reason="needs neovim")
def test_neovim_edits_with_the_server(tmp_path: Path) -> None:
    project = Project(tmp_path)
    script = tmp_path / "drive.lua"
    script.write_text(_SCRIPT)
    commands = Path(sys.executable).parent
    done = subprocess.run(
        ["nvim", "--headless", "--clean", "-n", "-c", f"luafile {_PLUGIN}", "-c", f"luafile {script}"],
        cwd=project.folder,
        env={**os.environ, "PATH": f"{commands}{os.pathsep}{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    out = json.loads(next(line for line in done.stderr.splitlines() if line.startswith("{")))
    assert "What is straight ahead." in out["hover"]
    assert "unknown name `clsoe`" in out["finding"]
    assert out["fix"] == "write `close`"
    assert "param space = 2" in out["text"]
    assert "limit = space" in out["text"]
    assert "when close" in out["text"]
