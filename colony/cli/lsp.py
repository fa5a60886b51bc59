"""`colony lsp`: the language server for editors."""

from __future__ import annotations

import click


@click.command("lsp", short_help="serve an editor: findings, completion and proofs while you type")
@click.option("--stdio", is_flag=True, help="Accepted, as many editors give it: there is no other way.")
def command(stdio: bool) -> None:
    """Speak the Language Server Protocol on standard input and output; editors start this command.

    Findings, quick fixes, hover, definitions, references, renaming, completion, outlines and colors follow
    what is typed. In a pause tests run and contracts are proved; lenses show the verdicts (docs/lsp.md).

    Exit code: 0 if the editor shut the session down or left, 1 otherwise.

    \b
    Example, for Neovim:
      vim.lsp.start_client({ cmd = { "colony", "lsp" }, root_dir = vim.fn.getcwd() })
    """
    from colony.editing.server.stdio import serve

    raise click.exceptions.Exit(serve())
