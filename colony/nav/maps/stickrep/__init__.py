"""The StickRep map format: its model, reader, writer and checks."""
