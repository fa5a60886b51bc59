-- ~/.config/nvim/plugin/colony.lua: files of the Colony language, with `colony lsp`.
vim.filetype.add({ extension = { colony = "colony" } })
vim.api.nvim_create_autocmd("FileType", {
  pattern = "colony",
  callback = function(event)
    vim.bo.commentstring, vim.bo.shiftwidth, vim.bo.expandtab = "# %s", 2, true
    local found = vim.fs.find({ "colony.toml", ".git" }, { upward = true, path = vim.fs.dirname(event.file) })
    local root = found[1] and vim.fs.dirname(found[1]) or vim.fn.getcwd()
    vim.lsp.start({ name = "colony", cmd = { "colony", "lsp" }, root_dir = root })
  end,
})
